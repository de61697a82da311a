//! Station and controller as two machines would run them: the real programs, two domains, and
//! between them only the link. One machine is enough, because domains do not see each other.

mod side;

use protocol::{Hello, PROTOCOL_VERSION, Role};
use side::{Link, POLL, Side, free_port, is_running, json};
use std::time::Duration;

/// Time for which short keys are valid: many times what two programs take to be linked.
const SHORT: Duration = Duration::from_secs(30);
/// Versions of no release: the next one, and this one by a machine of the other endianness.
const OTHER_VERSIONS: [u32; 2] = [PROTOCOL_VERSION + 1, PROTOCOL_VERSION.swap_bytes()];

/// Touches through a link until the share of ticks at full resolution is known.
fn assert_touches(link: &Link, station: &mut Side) {
    let mut controller = link.controller(&["--seconds", "8", "--json"]);
    station.wait_for("a controller is linked from");
    let result = json(controller.result());
    let count = |name: &str| result[name].as_u64().unwrap();
    assert!(count("contact_ticks") > 0, "{result}");
    assert!(count("contact_full_ticks") > 0, "{result}");
    assert!(count("vsps_received") > 0, "{result}");
    assert_eq!(count("contact_unbounded_ticks"), 0, "{result}");
    assert!(controller.said("linked to the station at"));
}

/// Fails to touch, and gives what both sides said.
fn assert_refused(link: &Link, station: &mut Side, controller: &str, named: &str) {
    let mut refused = link.controller(&["--json"]);
    refused.wait_for(controller);
    station.wait_for(named);
    assert!(!refused.said("linked to the station at"));
    assert!(!station.said("a controller is linked from"));
    assert_nothing_came(refused);
}

/// Ends a controller that was given nothing.
fn assert_nothing_came(mut controller: Side) {
    assert!(!controller.said("station found"));
    controller.interrupt();
    let result = json(controller.result());
    assert_eq!(result["vsps_received"], 0, "{result}");
    assert_eq!(result["contact_ticks"], 0, "{result}");
}

#[test]
fn a_touch_through_a_plain_link_reaches_full_resolution() {
    let link = Link::new("plain", &format!("tcp/127.0.0.1:{}", free_port()));
    let mut station = link.station();
    assert_touches(&link, &mut station);
}

#[test]
fn a_touch_through_an_encrypted_link_reaches_full_resolution() {
    let mut link = Link::new("tls", &format!("tls/127.0.0.1:{}", free_port()));
    link.make_keys("keys");
    let mut station = link.station();
    assert_touches(&link, &mut station);
}

#[test]
fn a_certificate_of_another_authority_is_refused_by_name_on_both_sides() {
    let mut link = Link::new("foreign", &format!("tls/127.0.0.1:{}", free_port()));
    link.make_keys("own");
    let mut station = link.station();
    link.make_keys("foreign");
    assert_refused(
        &link,
        &mut station,
        "was refused, its certificate is of another authority",
        "a controller refused this station, it does not know the authority",
    );
}

#[test]
fn a_controller_that_trusts_everybody_is_refused_by_name_on_both_sides() {
    let mut link = Link::new("thief", &format!("tls/127.0.0.1:{}", free_port()));
    link.make_keys("own");
    let mut station = link.station();
    link.make_keys("foreign");
    link.trust_too("own");
    assert_refused(
        &link,
        &mut station,
        "refused this controller, it does not know the authority",
        "a controller was refused, its certificate is of another authority",
    );
}

#[test]
fn a_plain_connection_to_an_encrypted_link_is_refused_by_name_on_both_sides() {
    let port = free_port();
    let mut link = Link::new("bare", &format!("tls/127.0.0.1:{port}"));
    link.make_keys("keys");
    let mut station = link.station();
    link.address = format!("tcp/127.0.0.1:{port}");
    assert_refused(
        &link,
        &mut station,
        "nobody answers at tcp/127.0.0.1",
        "a connection was refused, it is not encrypted",
    );
}

#[test]
fn a_controller_without_keys_says_how_to_get_them_and_calls_nobody() {
    let mut link = Link::new("none", &format!("tls/127.0.0.1:{}", free_port()));
    link.make_keys("keys");
    let station = link.station();
    link.lose_keys();
    let mut controller = link.controller(&[]);
    controller.wait_for("the link needs keys");
    assert!(controller.said("make them with `ve-station keys DIR`"));
    assert_eq!(controller.status().code(), Some(2));
    assert!(!station.said("link:"));
}

#[test]
fn expired_certificates_end_the_link_and_are_refused_by_name_on_both_sides() {
    let port = free_port();
    let mut link = Link::new("expired", &format!("tcp/127.0.0.1:{port}"));
    // The model is built before the keys are made.
    drop(link.station());
    link.address = format!("tls/127.0.0.1:{port}");
    link.make_short_keys(SHORT);
    let mut station = link.station();
    let mut controller = link.controller(&["--json"]);
    station.wait_for("a controller is linked from");
    controller.wait_for("was refused, its certificate has expired");
    assert!(controller.said("was lost; it is called again"));
    station.wait_for("a controller refused this station, for its clock this certificate is not");
    assert!(station.said("the link of the controller at"));
    let mut late = link.controller(&[]);
    late.wait_for("has expired on");
    assert_eq!(late.status().code(), Some(2));
    controller.interrupt();
    let result = json(controller.result());
    assert!(result["contact_ticks"].as_u64().unwrap() > 0, "{result}");
}

#[test]
fn a_station_of_another_version_is_named_and_not_believed() {
    let link = Link::new("old-a", &format!("tcp/127.0.0.1:{}", free_port()));
    let station = link.tunnel("ve-station");
    for version in OTHER_VERSIONS {
        let controller = link.controller(&["--json"]);
        let hello = Hello::of_version(version, Role::Station, 1, 0);
        let named = format!("speaks protocol version {version}");
        station.say_until(hello, || controller.said(&named));
        assert_nothing_came(controller);
    }
}

#[test]
fn a_controller_of_another_version_is_named_and_others_are_served() {
    let link = Link::new("old-b", &format!("tcp/127.0.0.1:{}", free_port()));
    let mut station = link.station();
    let controller = link.tunnel("hrtc");
    for version in OTHER_VERSIONS {
        let hello = Hello::of_version(version, Role::Controller, 1, 1);
        let named = format!("the peer speaks protocol version {version}");
        controller.say_until(hello, || station.said(&named));
    }
    drop(controller);
    assert_touches(&link, &mut station);
}

#[test]
fn two_tunnels_in_one_domain_are_refused() {
    let mut link = Link::new("round", &format!("tcp/127.0.0.1:{}", free_port()));
    link.share_domain();
    let _station = link.station();
    let mut controller = link.controller(&[]);
    controller.wait_for("another --domain");
    assert_eq!(controller.status().code(), Some(2));
}

#[test]
fn killed_tunnels_are_started_again_and_then_carry_a_touch() {
    let link = Link::new("killed", &format!("tcp/127.0.0.1:{}", free_port()));
    let mut controller = link.controller(&["--seconds", "15", "--json"]);
    controller.wait_for("no station at");
    controller.kill_tunnel();
    controller.wait_for("is started again");
    let mut station = link.station();
    station.kill_tunnel();
    station.wait_for("is started again");
    let result = json(controller.result());
    assert!(
        result["contact_full_ticks"].as_u64().unwrap() > 0,
        "{result}"
    );
}

#[test]
fn a_tunnel_ends_with_a_killed_program_and_leaves_its_port() {
    let link = Link::new("orphan", &format!("tcp/127.0.0.1:{}", free_port()));
    let mut station = link.station();
    let tunnel = station.tunnel();
    station.kill();
    while is_running(tunnel) {
        std::thread::sleep(POLL);
    }
    link.station();
}
