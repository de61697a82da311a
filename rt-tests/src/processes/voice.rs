//! A voice in a domain that says what neither program would: forged heartbeats.

use super::stop::is_set;
use super::watched::{PATIENCE, pause};
use protocol::{HELLO_PERIOD_MS, Hello};
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use transport::Domain;

/// Says this as often as a program would, until something is so.
///
/// # Errors
/// One sentence when it never is, or the domain refuses.
pub fn say_until(
    domain: &Domain,
    hello: Hello,
    stop: &AtomicBool,
    mut so: impl FnMut() -> bool,
) -> Result<(), String> {
    let node = domain.node().map_err(|error| error.to_string())?;
    let topic = domain.heartbeats(&node);
    let topic = topic.map_err(|error| error.to_string())?.outgoing;
    let start = Instant::now();
    while !so() {
        if is_set(stop) {
            return Err("ended early on request".to_string());
        }
        if start.elapsed() > PATIENCE {
            return Err("a forged heartbeat was not answered for".to_string());
        }
        let sent = topic.send_copy(hello);
        sent.map_err(|error| format!("{error:?}"))?;
        pause(HELLO_PERIOD_MS as f64 * 1e-3, stop);
    }
    Ok(())
}
