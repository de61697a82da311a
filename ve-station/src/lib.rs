//! The VE station as a process: it builds SPM files and serves them.
//!
//! | module | is |
//! |---|---|
//! | [`export`] | an SPM file as a plain mesh, or in the thesis's text formats |
//! | [`inspect`] | what an SPM file holds, for people and scripts |
//! | [`output`] | whether a file may be written |
//! | [`database`] | the models of a scene, and the cache of built ones |
//! | `file_bytes` | the bytes of a file, safe from whoever overwrites it |
//! | [`viewer`] | `serve --view`: what a controller on this machine touches, in rerun |
//! | [`clients`] | who is connected, and the line about it |
//! | `telling` | who is connected, told without waiting for whoever reads |
//! | [`connection`], [`serve`] | the iceoryx2 ports around the pure core ([`station_core`]), and the command |
//!
//! # Two machines
//! Built with `--features tunnel`, station and controller (`hrtc`) meet across a network. Once, on
//! the station, with the name or address by which the controller reaches it:
//! ```sh
//! ve-station keys keys --host 192.168.1.10
//! ```
//! It prints the commands that copy each side's keys to `hrtc/keys` in its user's folder of
//! settings (`~/.config`). Then
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
//! ## The machines
//! - **Cable**: one cable or one switch between the two, no radio: a lost packet costs a repetition
//!   of 0.2 s and more. 10 Mbit/s carry a hand at 0.1 m/s; slower and longer links work, with a
//!   larger certified error while the hand moves.
//! - **Port**: only the station's firewall opens one: `sudo ufw allow 7447/tcp`, or
//!   `sudo firewall-cmd --permanent --add-port=7447/tcp && sudo firewall-cmd --reload`.
//! - **Rights**: both programs run as ordinary users; the controller's has those to
//!   real-time priorities and locked memory (README, "have real-time rights without root").
//! - **Clocks**: right to a day on both, since certificates have dates (`timedatectl`). Nothing
//!   else compares them.
//! - **Kernel**: the controller's with PREEMPT_RT (`uname -v` names it; Debian: `sudo apt install
//!   linux-image-rt-amd64`). The station needs none.
//! - **Core**: one of the controller's for the tick alone: `isolcpus=1 nohz_full=1 rcu_nocbs=1` on
//!   the kernel's command line for `core = 1` of the scene. `rt-tests jitter` shows what it is
//!   worth.
//!
//! ## The latency
//! The tick waits for no link: contact and force are made of what is loaded, every millisecond. The
//! way there and back takes what `ping` says, and some in the programs; `round_trip_ms` in the
//! result of `hrtc run --json` is the measure. What a link is worth with a model, a cache and a
//! speed is seen on one machine, before any cable lies:
//! ```sh
//! rt-tests hosts --rtt-ms 20 --mbit 10 --model my.ply --cache 4MiB --speed 0.1
//! ```
//!
//! ## The messages
//! What the link says begins with `link:`, and is said again with its number when it is ten times
//! as many. The sentence on lines that are left out is anybody's.
//!
//! | it says | do |
//! |---|---|
//! | *is not part of this build* | build both programs with `--features tunnel` |
//! | *the link needs keys* | make them as above, and copy them as that says |
//! | *off this machine a link needs keys* | write `tls/` |
//! | *may be read by others* | `chmod 600` on that file |
//! | *and this is the* | copy the keys of the other side: station's and controller's differ |
//! | *is not of the authority*, *does not belong to the certificate* | copy all three files of a side from one `ve-station keys` |
//! | *is damaged* | copy the file again |
//! | *cannot listen on* | stop who has the port, or choose another on both sides |
//! | *has a tunnel already* | stop the other program, or give one of them another `--domain` |
//! | *no station listens at*, *no station at* | start the station; look at address, port and firewall |
//! | *nobody answers at* | call `tls/` where the station listens with `tls/`; look for who has that port |
//! | *no encrypted link is called by an IPv6 address* | call the name for which `keys --host NAME` was run, or an IPv4 address |
//! | *cannot be called* | mend the network or the name of the host |
//! | *its certificate is of another authority*, *it does not know the authority* | copy the keys of both sides from one `ve-station keys` |
//! | *has expired*, *is not valid yet*, *is not valid now* | make keys again for both sides; set the clocks right |
//! | *its certificate does not hold that name*, *does not hold the name by which it calls* | make keys with `--host` and the name that the controller calls |
//! | *it shows no certificate*, *it was shown no certificate* | somebody without keys calls: copy them, or find out who |
//! | *it is not encrypted* | let the controller call `tls/` |
//! | *it does not speak as a link does* | nothing, if somebody only scans ports |
//! | *speaks protocol version* | install the same release on both machines |
//! | *was lost; it is called again* | look at the cable: the touch goes on with its certified error meanwhile |
//! | *more arrives than this machine takes* | nothing; if it repeats, find out what takes its cores |
//! | *the process of the tunnel ended* | nothing; if it repeats, report what it says |
//! | *another station serves the domain* | stop one of them |
//! | *serves as many controllers as it can* | stop one, or start another station |
//! | *lines that nobody read in time, left out here* | nothing; read standard error, or send it to a file |

pub mod clients;
pub mod connection;
pub mod database;
pub mod export;
mod file_bytes;
pub mod inspect;
pub mod output;
pub mod serve;
mod telling;
mod tuning;
pub mod viewer;

pub use file_bytes::FileBytes;
