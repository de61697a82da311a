//! The rights of this process.

/// A right that Linux knows by a number (`linux/capability.h`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capability {
    number: u32,
    /// Its name.
    pub name: &'static str,
}

/// Making networks and their devices.
pub const NET_ADMIN: Capability = Capability {
    number: 12,
    name: "CAP_NET_ADMIN",
};
/// Mounting.
pub const SYS_ADMIN: Capability = Capability {
    number: 21,
    name: "CAP_SYS_ADMIN",
};
/// Setting the clock.
pub const SYS_TIME: Capability = Capability {
    number: 25,
    name: "CAP_SYS_TIME",
};

impl Capability {
    /// Whether this process has it.
    #[must_use]
    pub fn is_held(self) -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
        let mask = line.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok());
        mask.is_some_and(|mask| mask >> self.number & 1 == 1)
    }
}
