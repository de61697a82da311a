//! Callers that no check of their own keeps from calling: the listener refuses them, by name on
//! both sides. What is read here are zenoh's own lines, so that another version of it cannot change
//! them unseen.

use crate::address::Address;
use crate::authority::{Validity, make_keys_for};
use crate::key_files::{KeyFiles, Role};
use crate::notes::Notes;
use crate::settings::{End, show_no_certificate, zenoh_settings};
use serde_json::Value;
use std::net::TcpListener;
use std::path::Path;
use std::time::{Duration, Instant};
use time::OffsetDateTime;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use zenoh::{Session, Wait};

/// What is not so by then never will be: no measure of anything.
const HANGING: Duration = Duration::from_secs(60);
/// Time between two looks.
const POLL: Duration = Duration::from_millis(5);
/// A topic that crosses.
const TOPIC: &str = "iox2/topic";

/// A certificate valid from so many days after now to so many.
fn days(first: i64, last: i64) -> Validity {
    let now = OffsetDateTime::now_utc();
    let after = |days: i64| now + time::Duration::days(days);
    (after(first), after(last))
}

/// Both ends of a link at a port that nobody has.
fn ends() -> [End; 2] {
    let socket = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = socket.local_addr().unwrap().port();
    let address = format!("tls/127.0.0.1:{port}");
    [
        End::Listen(Address::to_listen(&address).unwrap()),
        End::Call(Address::to_call(&address).unwrap()),
    ]
}

/// The settings of an end with the keys of a side, whosever they are.
fn settings(end: &End, keys: &Path, side: Role) -> Value {
    let keys = KeyFiles::in_folder(&keys.join(side.name())).unwrap();
    zenoh_settings(end, Some(&keys))
}

fn open(settings: &Value) -> Session {
    let settings = zenoh::Config::from_json5(&settings.to_string()).unwrap();
    zenoh::open(settings).wait().unwrap()
}

fn wait_until(what: &str, mut so: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !so() {
        assert!(begin.elapsed() < HANGING, "never so: {what}");
        std::thread::sleep(POLL);
    }
}

fn is_linked(session: &Session) -> bool {
    session.info().peers_zid().wait().next().is_some()
}

/// A caller: its certificate's validity, what it does with its settings, and the words for it.
struct Stranger {
    validity: Validity,
    change: fn(&mut Value),
    at_listener: &'static str,
    at_caller: &'static str,
}

#[test]
fn who_shows_no_valid_certificate_is_refused_by_name_on_both_sides_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let [listen, call] = ends();
    let [heard, called] = [(); 2].map(|()| Notes::default());
    tracing_subscriber::registry()
        .with(heard.refusals(&listen))
        .with(called.refusals(&call))
        .init();
    let strangers = [
        Stranger {
            validity: days(-1, 1),
            change: show_no_certificate,
            at_listener: "a connection was refused, it shows no certificate",
            at_caller: "refused this controller, it was shown no certificate",
        },
        Stranger {
            validity: days(-3, -1),
            change: |_| {},
            at_listener: "a controller was refused, its certificate has expired",
            at_caller: "refused this controller, for its clock this certificate is not valid now",
        },
        Stranger {
            validity: days(1, 3),
            change: |_| {},
            at_listener: "a controller was refused, its certificate is not valid yet",
            at_caller: "refused this controller, for its clock this certificate is not valid now",
        },
    ];
    for (number, stranger) in strangers.iter().enumerate() {
        let keys = folder.path().join(number.to_string());
        let validity = |role: Role| match role {
            Role::Station => days(-1, 1),
            Role::Controller => stranger.validity,
        };
        make_keys_for(&keys, &[], &validity).unwrap();
        let listener = open(&settings(&listen, &keys, Role::Station));
        let before = called.counted_so_far(stranger.at_caller);
        let mut theirs = settings(&call, &keys, Role::Controller);
        (stranger.change)(&mut theirs);
        let caller = open(&theirs);
        // It calls again, and is counted again.
        wait_until(stranger.at_listener, || {
            heard.counted_so_far(stranger.at_listener) >= 2
        });
        wait_until(stranger.at_caller, || {
            called.counted_so_far(stranger.at_caller) >= before + 2
        });
        assert!(!is_linked(&listener) && !is_linked(&caller));
        caller.close().wait().unwrap();
        listener.close().wait().unwrap();
    }
}

#[test]
fn the_keys_of_a_station_hear_nothing_where_controllers_do() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys");
    make_keys_for(&keys, &[], &|_| days(-1, 1)).unwrap();
    let [listen, call] = ends();
    let listener = open(&settings(&listen, &keys, Role::Station));
    let callers = [Role::Station, Role::Controller];
    let [stranger, controller] = callers.map(|side| open(&settings(&call, &keys, side)));
    let of = |session: &Session| session.declare_subscriber(TOPIC).wait().unwrap();
    let [of_stranger, of_controller] = [&stranger, &controller].map(of);
    wait_until("both are linked", || {
        is_linked(&stranger) && is_linked(&controller)
    });
    let mut received = 0;
    wait_until("the controller hears", || {
        listener.put(TOPIC, "a chunk").wait().unwrap();
        received += of_controller.drain().count();
        received > 10
    });
    assert_eq!(of_stranger.drain().count(), 0);
}
