//! The tests of the example, which cargo builds but does not run.

#[path = "../examples/custom_device.rs"]
#[expect(dead_code, reason = "its main")]
mod custom_device;
