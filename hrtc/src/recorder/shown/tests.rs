use super::*;
use haptic_device::Sample;
use hrtc_core::ProbeContact;
use hrtc_core::contact::sphere_proxy::Contact;
use prost_reflect::DescriptorPool;

/// A record with something to show in every channel.
fn record() -> TickRecord {
    let mut record = TickRecord {
        tick: 7,
        skipped: 2,
        ..TickRecord::default()
    };
    record.samples[0] = Some(Sample::at(Pose::IDENTITY));
    record.contacts[0] = Some(ProbeContact {
        object: 0,
        contact: Contact::at(0, DVec3::ZERO),
    });
    record.wrenches[0].force = DVec3::new(1.0, f64::NAN, -3.0);
    record.core.work_units = 9;
    record
}

#[test]
fn every_message_is_read_by_the_description_in_the_file() {
    let schemas = Schemas::new().unwrap();
    let pool = DescriptorPool::decode(&schemas.description[..]).unwrap();
    let display = Display {
        schemas: &schemas,
        now_ns: 3_000_000_004,
    };
    let record = record();
    let of_probe = Shown::OF_PROBE.map(|shown| (shown, display.of_probe(shown, 0, &record, None)));
    let of_run = Shown::OF_RUN.map(|shown| match shown {
        Shown::Event => (shown, display.event(Level::Warning, "it is late")),
        _ => (shown, display.of_run(shown, &record)),
    });
    for (shown, bytes) in of_probe.into_iter().chain(of_run) {
        let Some(bytes) = bytes.unwrap() else {
            assert_eq!(shown, Shown::Proxy, "there is no twin");
            continue;
        };
        let described = pool.get_message_by_name(shown.schema_name()).unwrap();
        let read = DynamicMessage::decode(described, &bytes[..]).unwrap();
        assert_eq!(read.unknown_fields().count(), 0, "{shown:?}");
        let field = |name: &str| read.get_field_by_name(name).unwrap().into_owned();
        match shown {
            Shown::Wrench => {
                let force = field("force");
                let of = |name| {
                    force
                        .as_message()
                        .unwrap()
                        .get_field_by_name(name)
                        .unwrap()
                        .as_f64()
                };
                assert_eq!((of("x"), of("z")), (Some(1.0), Some(-3.0)));
                assert!(of("y").unwrap().is_nan(), "no number is not 0");
            }
            Shown::Budget => assert_eq!(field("work_units").as_u64(), Some(9)),
            Shown::Miss => assert_eq!(field("skipped").as_u64(), Some(2)),
            Shown::Event => {
                assert_eq!(field("message").as_str(), Some("it is late"));
                assert_eq!(field("level").as_enum_number(), Some(3));
                let time = field("timestamp");
                let nanos = time
                    .as_message()
                    .unwrap()
                    .get_field_by_name("nanos")
                    .unwrap()
                    .as_i32();
                assert_eq!(nanos, Some(4));
            }
            _ => {}
        }
    }
}
