use super::*;
use iceoryx2::prelude::CallbackProgression;
use iceoryx2::service::Service;
use protocol::PROTOCOL_VERSION;
use std::collections::{BTreeMap, BTreeSet};

#[test]
fn names_that_are_no_single_path_entry_are_refused() {
    for bad in ["", "a/b", "..", "a b", "ü", "a_b", &"x".repeat(33)] {
        assert!(Domain::new(bad).is_err(), "{bad}");
    }
    let domain = Domain::new("test-1-a").unwrap();
    let config = domain.config_of(1000).unwrap();
    let root = config.global.root_path().to_string();
    assert_eq!(root, "/tmp/hrtc-1000-test-1-a/");
    assert_eq!(config.global.prefix.to_string(), "hrtc_1000-test-1-a_");
}

#[test]
fn domains_of_two_users_share_no_file() {
    let domain = Domain::new(&"x".repeat(MAX_NAME_BYTES)).unwrap();
    let [one, other] = [0, u32::MAX].map(|user| domain.config_of(user).unwrap().global);
    assert_ne!(one.root_path(), other.root_path());
    let [one, other] = [one, other].map(|global| global.prefix.to_string());
    assert!(!one.starts_with(&other) && !other.starts_with(&one));
}

#[test]
fn a_root_that_is_not_the_users_own_is_refused_in_a_sentence() {
    let domain = Domain::new(&format!("root-{}", std::process::id())).unwrap();
    let root = domain.root();
    let refused = |what: &str| {
        let sentence = domain.node().unwrap_err().to_string();
        assert!(sentence.contains(what), "{sentence}");
        assert!(sentence.contains("--domain"), "{sentence}");
        assert!(sentence.contains(&root.display().to_string()), "{sentence}");
    };
    std::fs::write(&root, "").unwrap();
    refused("is no folder");
    std::fs::remove_file(&root).unwrap();
    let elsewhere = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(elsewhere.path(), &root).unwrap();
    refused("is no folder");
    std::fs::remove_file(&root).unwrap();
    std::fs::create_dir(&root).unwrap();
    if std::os::unix::fs::chown(&root, Some(user() + 1), None).is_ok() {
        refused("belongs to the user");
    } else {
        println!("skipped: only root gives a folder away");
    }
    std::fs::remove_dir(&root).unwrap();
    drop(domain.node().unwrap());
    let mode = std::fs::symlink_metadata(&root).unwrap().mode();
    assert_eq!(mode & 0o077, 0, "others may look in");
    domain.remove_files();
}

/// Asks as systemd-tmpfiles does before it goes into a folder (tmpfiles.d(5), "Age").
#[test]
fn nobody_cleans_up_in_the_root_of_a_domain_that_is_used() {
    let domain = Domain::new(&format!("held-{}", std::process::id())).unwrap();
    let is_held = || File::open(domain.root()).unwrap().try_lock().is_err();
    domain.take_root().unwrap();
    assert!(!is_held(), "nobody uses it");
    let node = domain.node().unwrap();
    assert!(is_held());
    let other = File::open(domain.root()).unwrap();
    assert!(other.try_lock_shared().is_ok(), "for one process only");
    drop((node, other));
    domain.remove_files();
    domain.take_root().unwrap();
    assert!(!is_held(), "who has removed it has let go of it");
    domain.hold_root();
    std::fs::remove_dir(domain.root()).unwrap();
    // By somebody else, and made again.
    domain.take_root().unwrap();
    assert!(!is_held());
    domain.hold_root();
    assert!(is_held());
    domain.remove_files();
}

/// As systemd-tmpfiles that is stopped while it cleans up.
#[test]
fn nobody_waits_for_whoever_has_the_root_alone_and_does_not_go_on() {
    let domain = Domain::new(&format!("alone-{}", std::process::id())).unwrap();
    domain.take_root().unwrap();
    let alone = File::open(domain.root()).unwrap();
    alone.lock().unwrap();
    drop(domain.node().unwrap());
    drop(alone);
    drop(domain.node().unwrap());
    let is_held = File::open(domain.root()).unwrap().try_lock().is_err();
    assert!(is_held, "it is not tried again");
    domain.remove_files();
}

/// The topics of a domain in which all are open: by name those of the types in their messages that
/// are the protocol's.
fn open_topics(test: &str) -> BTreeMap<String, Vec<String>> {
    let domain = Domain::new(&format!("{test}-{}", std::process::id())).unwrap();
    let node = domain.node().unwrap();
    let _open = (
        domain.hello_service(&node).unwrap(),
        domain.subscribe_service(&node).unwrap(),
        domain.pose_service(&node).unwrap(),
        domain.records_service(&node, 7).unwrap(),
    );
    let mut topics = BTreeMap::new();
    let listed = <ipc::Service as Service>::list(&domain.config().unwrap(), |service| {
        let details = &service.static_details;
        let types = details.publish_subscribe().message_type_details();
        let types = [types.payload, types.user_header].map(|of| of.type_name().to_string());
        let own = types.into_iter().filter(|of| of.starts_with("hrtc."));
        topics.insert(details.name().to_string(), own.collect());
        CallbackProgression::Continue
    });
    listed.unwrap();
    drop((_open, node));
    domain.remove_files();
    topics
}

#[test]
fn every_name_but_the_heartbeats_holds_the_version() {
    let mut topics = open_topics("version");
    assert_eq!(topics.remove(HELLO_TOPIC), Some(vec!["hrtc.Hello".into()]));
    let begin = format!("hrtc/v{PROTOCOL_VERSION}/");
    assert!(
        topics.keys().all(|name| name.starts_with(&begin)),
        "{topics:?}"
    );
    let types: BTreeSet<String> = topics.into_values().flatten().collect();
    let expected = ["ChunkHeader", "ChunkSlot", "ContactReport", "RequestWord"];
    let expected = expected.map(|name| format!("hrtc.{name}.v{PROTOCOL_VERSION}"));
    assert!(types.iter().eq(&expected), "{types:?}");
}

#[test]
fn a_tunnel_carries_every_topic() {
    let topics = open_topics("carried");
    let names: Vec<&String> = topics.keys().collect();
    assert_eq!(names.len(), CARRIED_TOPICS.len(), "{names:?}");
    for topic in CARRIED_TOPICS {
        let begin = topic.trim_end_matches('*');
        let of_topic = names.iter().filter(|name| name.starts_with(begin));
        assert_eq!(of_topic.count(), 1);
    }
}

#[test]
fn the_file_for_tunnels_equals_the_embedded_configuration() {
    let text = include_str!("../../../../config/iceoryx2.toml");
    let file: Config = toml::from_str(text).expect("config/iceoryx2.toml is a configuration");
    let domain = Domain::new("hrtc").unwrap();
    assert_eq!(file, domain.config_of(1000).unwrap());
}
