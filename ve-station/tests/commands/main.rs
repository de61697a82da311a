//! The commands of `ve-station` as users meet them.

#[path = "../common/mod.rs"]
mod common;

mod export;
mod messages;
mod tours_on_a_slow_disk;
