//! The version of the protocol, and the names of the topics, which hold it.

/// Makes the version, and every name that holds it, of one number.
macro_rules! version {
    ($version:literal) => {
        /// Version of the protocol; part of every topic's name but the heartbeat's, so that
        /// programs of two versions meet on that one only.
        pub const PROTOCOL_VERSION: u32 = $version;
        /// Topic of [`Request`](crate::Request)s.
        pub const SUBSCRIBE_TOPIC: &str = concat!("hrtc/v", $version, "/subscribe");
        /// Topic of [`ContactReport`](crate::ContactReport)s.
        pub const POSE_TOPIC: &str = concat!("hrtc/v", $version, "/pose");
        /// Topics of chunks, `*` for the client.
        pub const RECORDS_TOPICS: &str = concat!("hrtc/v", $version, "/records/*");
    };
}

// The names of the types in `wire` must be literals; a test of the crate `transport` compares them.
version!(12);

/// Topic of [`Hello`](crate::Hello)s, the same in every version.
pub const HELLO_TOPIC: &str = "hrtc/hello";

/// Topic of the chunks for one client.
#[must_use]
pub fn records_topic(client: u64) -> String {
    RECORDS_TOPICS.replace('*', &format!("{client:016x}"))
}
