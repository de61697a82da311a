//! Hosts on this machine, and the links between them: what two commands try.
//!
//! | module | holds |
//! |---|---|
//! | `points` | the links that are tried |
//! | `programs` | the two programs, and the rights that hosts need |
//! | `way` | what becomes of a packet: one direction of a link |
//! | `relay` | the thread that carries packets between the cables of hosts |
//! | `hosts` | hosts, each with a link to the station's |

pub mod hosts;
pub mod points;
pub mod programs;
pub mod relay;
pub mod way;
