//! Another host on this machine: a network with one cable and nothing else, and its own shared
//! memory, made of namespaces of the kernel. Only the files of the disk are the same.
//!
//! The cable is a TUN device: what the host sends comes out of a file as IP packets, and packets
//! that are written into it arrive there. Everything goes with the last process and file of it.

use super::mounts::{SmallDisk, mount_in_memory, unshare_mounts};
use std::ffi::{CStr, CString};
use std::fs::File;
use std::io;
use std::net::Ipv4Addr;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// The device of all cables.
pub const TUN: &str = "/dev/net/tun";
/// Name of the cable at its host, and of the host's way to itself.
const CABLE: &CStr = c"cable";
const LOOPBACK: &CStr = c"lo";
/// All hosts on a cable have the first 24 bits of their addresses in common.
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// A host; processes enter it.
#[derive(Debug)]
pub struct Host {
    network: OwnedFd,
    mounts: OwnedFd,
    /// Where its processes begin.
    folder: CString,
}

/// A word on what was tried, for an error of the system.
fn trying(what: &'static str) -> impl FnOnce(io::Error) -> String {
    move |error| format!("{what} was refused ({error})")
}

impl Host {
    /// A host of an address with its end of a cable (not blocking); `private` is a folder of which
    /// it has one of its own, empty, beside that of shared memory.
    ///
    /// # Errors
    /// What the system refused, as a part of a sentence.
    pub fn new(address: Ipv4Addr, private: &Path) -> Result<(Self, File), String> {
        let text = |path: &Path| {
            let text = CString::new(path.as_os_str().as_bytes());
            text.map_err(|error| format!("{} is no folder ({error})", path.display()))
        };
        let here = std::env::current_dir().map_err(trying("the current folder"))?;
        let folder = text(&here)?;
        let disks = [
            SmallDisk {
                folder: c"/dev/shm".into(),
                options: c"mode=1777".into(),
            },
            SmallDisk {
                folder: text(private)?,
                options: c"mode=0700".into(),
            },
        ];
        // Namespaces are a thread's until a process enters them.
        let make = std::thread::Builder::new().name("host".to_owned());
        let made = make
            .spawn(move || furnish(address, &disks))
            .map_err(trying("a thread"))?;
        let ended = |_| "the thread that makes a host ended".to_string();
        let (network, mounts, cable) = made.join().map_err(ended)??;
        let host = Self {
            network,
            mounts,
            folder,
        };
        Ok((host, cable))
    }

    /// Moves the calling process to it. Allocates nothing.
    ///
    /// # Errors
    /// When the system refuses: the right CAP_SYS_ADMIN is missing.
    pub(super) fn enter(&self) -> io::Result<()> {
        // SAFETY: the files are open as long as this lives, and the path ends with 0.
        let is_done = unsafe {
            libc::setns(self.network.as_raw_fd(), libc::CLONE_NEWNET) == 0
                && libc::setns(self.mounts.as_raw_fd(), libc::CLONE_NEWNS) == 0
                && libc::chdir(self.folder.as_ptr()) == 0
        };
        if is_done {
            Ok(())
        } else {
            Err(io::Error::last_os_error())
        }
    }
}

/// Makes the calling thread a host of its own.
fn furnish(address: Ipv4Addr, disks: &[SmallDisk]) -> Result<(OwnedFd, OwnedFd, File), String> {
    unshare_mounts(libc::CLONE_NEWNET).map_err(trying("a network and mounts of its own"))?;
    for disk in disks {
        mount_in_memory(disk).map_err(trying("a folder in memory"))?;
    }
    let cable = File::options()
        .read(true)
        .write(true)
        .custom_flags(libc::O_NONBLOCK)
        .open(TUN)
        .map_err(trying(TUN))?;
    let mut request = request(CABLE);
    request.ifr_ifru.ifru_flags = (libc::IFF_TUN | libc::IFF_NO_PI) as libc::c_short;
    control(&cable, libc::TUNSETIFF, &mut request).map_err(trying("a TUN device"))?;
    connect(address).map_err(trying("an address"))?;
    let open = |name: &str| -> Result<OwnedFd, String> {
        let file = File::open(format!("/proc/thread-self/ns/{name}"));
        Ok(file.map_err(trying("its name"))?.into())
    };
    Ok((open("net")?, open("mnt")?, cable))
}

/// Gives the cable its address, and switches it and the way to itself on.
fn connect(address: Ipv4Addr) -> io::Result<()> {
    // SAFETY: takes plain numbers.
    let socket = unsafe { libc::socket(libc::AF_INET, libc::SOCK_DGRAM | libc::SOCK_CLOEXEC, 0) };
    if socket < 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: it was just opened and is nobody else's.
    let socket = unsafe { OwnedFd::from_raw_fd(socket) };
    let mut cable = request(CABLE);
    for (what, value) in [(libc::SIOCSIFADDR, address), (libc::SIOCSIFNETMASK, MASK)] {
        cable.ifr_ifru.ifru_addr = socket_address(value);
        control(&socket, what, &mut cable)?;
    }
    for name in [CABLE, LOOPBACK] {
        let mut device = request(name);
        device.ifr_ifru.ifru_flags = (libc::IFF_UP | libc::IFF_RUNNING) as libc::c_short;
        control(&socket, libc::SIOCSIFFLAGS, &mut device)?;
    }
    Ok(())
}

/// A request about a device.
fn request(name: &CStr) -> libc::ifreq {
    // SAFETY: all zeros is a valid request.
    let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
    for (to, from) in request.ifr_name.iter_mut().zip(name.to_bytes()) {
        *to = *from as libc::c_char;
    }
    request
}

fn socket_address(address: Ipv4Addr) -> libc::sockaddr {
    let [a, b, c, d] = address.octets().map(|byte| byte as libc::c_char);
    libc::sockaddr {
        sa_family: libc::AF_INET as libc::sa_family_t,
        // A port of two bytes, then the address.
        sa_data: [0, 0, a, b, c, d, 0, 0, 0, 0, 0, 0, 0, 0],
    }
}

fn control(file: &impl AsRawFd, what: libc::Ioctl, request: &mut libc::ifreq) -> io::Result<()> {
    // SAFETY: all requests used here take one of this structure, which lives through the call.
    if unsafe { libc::ioctl(file.as_raw_fd(), what, std::ptr::from_mut(request)) } == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}
