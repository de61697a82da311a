use super::*;
use std::thread;
use std::time::Duration;

const STATION: u64 = 71;
/// A hang of the test, not a measurement.
const LONG: Duration = Duration::from_secs(60);

/// Stops a station also when the test fails.
struct Stops<'a>(&'a AtomicBool);

impl Drop for Stops<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Takes the station's heartbeats that have come.
fn take_heartbeats(hello: &Heartbeats) -> usize {
    let received = std::iter::from_fn(|| hello.incoming.receive().unwrap());
    let greetings = received.filter_map(|sample| sample.read().ok());
    greetings.filter(|of| of.incarnation == STATION).count()
}

fn wait_for_heartbeats(hello: &Heartbeats, count: usize) {
    let (began, mut found) = (Instant::now(), 0);
    while found < count {
        assert!(began.elapsed() < LONG, "it hangs at {found} of {count}");
        thread::sleep(Duration::from_millis(1));
        found += take_heartbeats(hello);
    }
}

/// As in a program that shows its events on a terminal, which is paused.
#[test]
fn a_warning_that_nobody_reads_stops_no_heartbeat() {
    transport::logging::start();
    let domain = Domain::new(&format!("warned-{}", std::process::id())).unwrap();
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let station = Station::<Vec<u8>>::new(STATION, vec![], vec![]);
            Connection::open(&domain, station).unwrap().run(&stop);
        });
        let _stops = Stops(&stop);
        let node = domain.node().unwrap();
        let hello = domain.heartbeats(&node).unwrap();
        wait_for_heartbeats(&hello, 1);
        // Whoever else writes to it waits from here on.
        let _paused = std::io::stderr().lock();
        // That of another station is warned of. It comes here too.
        let other = Hello::new(Role::Station, STATION + 1, 0);
        assert_eq!(hello.outgoing.send_copy(other).unwrap(), 2);
        take_heartbeats(&hello);
        // One may have been under way.
        wait_for_heartbeats(&hello, 3);
    });
    domain.remove_files();
}
