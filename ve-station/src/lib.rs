//! The VE station as a process: it builds SPM files and serves them.
//!
//! | module | is |
//! |---|---|
//! | [`export`] | an SPM file as a plain mesh, or in the thesis's text formats |
//! | [`inspect`] | what an SPM file holds, for people and scripts |
//! | [`database`] | the models of a scene, and the cache of built ones |
//! | `file_bytes` | the bytes of a file, safe from whoever overwrites it |
//! | [`clients`] | who is connected, and the line about it |
//! | [`connection`], [`serve`] | the iceoryx2 ports around the pure core ([`station_core`]), and the command |
//!
//! # Two machines
//! Built with `--features tunnel`, station and controller (`hrtc`) meet across a network. Once, on
//! the station, with the name or address by which the controller reaches it:
//! ```sh
//! ve-station keys keys --host 192.168.1.10
//! ```
//! It prints the commands that copy each side's keys to `~/.config/hrtc/keys`. Then
//! ```sh
//! ve-station serve scene.toml --listen tls/0.0.0.0:7447   # on the station
//! hrtc run --station tls/192.168.1.10:7447                # on the controller
//! ```
//! Nothing else is started: each program runs the link in a process of its own, watches it and
//! starts it again. Only the station needs files: the controller is given the scene with its tools,
//! height maps and trajectories by the hash of their content, and keeps them in its cache folder
//! (`$HRTC_CACHE`, else `hrtc/models` in the user's cache); no path travels. Options of `hrtc run`
//! stand over the station's, a scene file given to it over the station's scene. `--max-force` and
//! `--max-torque` of the controller hold whatever the scene says, but raise nothing; `--device` is
//! its own device. Both machines have the same build, and clocks that are right to a day. The
//! station's firewall lets TCP port 7447 in. On one machine, `tcp/127.0.0.1:7447` needs no keys,
//! and one side needs another `--domain`. A wired network is best: what is there and back sooner is
//! refined sooner.
//!
//! What the link says begins with `link:`.
//!
//! | it says | do |
//! |---|---|
//! | *no station listens* | start the station; look at address, port and firewall |
//! | *nobody answers as a station does* | call `tls/` where the station listens with `tls/` |
//! | *cannot be called (...)* | mend the network or the name of the host |
//! | *certificate is of another authority* | copy the keys of both sides from one `ve-station keys` |
//! | *has expired*, *is not valid yet* | make keys again; set the clocks right |
//! | *does not hold that name* | make keys with `--host` and the name that the controller calls |
//! | *the link was lost* | look at the cable: the touch goes on with its certified error meanwhile |
//! | *the process of the tunnel ended* | nothing; if it repeats, report what it says |

pub mod clients;
pub mod connection;
pub mod database;
pub mod export;
mod file_bytes;
pub mod inspect;
pub mod serve;
mod tuning;

pub use file_bytes::FileBytes;
