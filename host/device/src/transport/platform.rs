//! What depends on the operating system: who may open a port, who holds it, pseudo-terminals.
//!
//! Linux is where this was built and run. On other Unixes the hints are shorter; on Windows there are no
//! pseudo-terminals, and `sim:` and `tcp:` take their place.

use std::path::Path;

/// The name of the group that a file belongs to, where that can be known.
#[cfg(unix)]
#[must_use]
pub(crate) fn owning_group(path: &Path) -> Option<String> {
    use std::os::unix::fs::MetadataExt;
    let group = std::fs::metadata(path).ok()?.gid().to_string();
    let groups = std::fs::read_to_string("/etc/group").ok()?;
    let name = groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)? == group).then_some(name)
    });
    name.map(str::to_owned)
}

/// The name of the group that a file belongs to: not known on this system.
#[cfg(not(unix))]
#[must_use]
pub(crate) fn owning_group(_path: &Path) -> Option<String> {
    None
}

/// The process, other than this one, that has `path` open, as `name (process 123)`, where that can be known.
#[cfg(target_os = "linux")]
#[must_use]
pub(crate) fn holder(path: &Path) -> Option<String> {
    let device = std::fs::canonicalize(path).ok()?;
    let own = std::process::id().to_string();
    std::fs::read_dir("/proc").ok()?.flatten().find_map(|process| {
        let number = process.file_name().into_string().ok()?;
        if number == own || !number.bytes().all(|byte| byte.is_ascii_digit()) {
            return None;
        }
        let mut files = std::fs::read_dir(process.path().join("fd")).ok()?.flatten();
        files.find(|file| std::fs::read_link(file.path()).is_ok_and(|target| target == device))?;
        let name = std::fs::read_to_string(process.path().join("comm")).unwrap_or_default();
        Some(format!("{} (process {number})", name.trim()))
    })
}

/// The process that has `path` open: not known on this system.
#[cfg(not(target_os = "linux"))]
#[must_use]
pub(crate) fn holder(_path: &Path) -> Option<String> {
    None
}

/// Pseudo-terminals: a serial port without hardware.
#[cfg(unix)]
pub(crate) mod pty {
    use std::fs::File;
    use std::io;

    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::fs::{Mode, OFlags};
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

    /// The device's end of a pseudo-terminal.
    #[derive(Debug)]
    pub(crate) struct Pty {
        /// Reading and writing do not block.
        pub(crate) device_end: File,
        /// What the host opens as if it were a serial port.
        pub(crate) path: String,
    }

    impl Pty {
        /// Opens a new pseudo-terminal in raw mode.
        ///
        /// # Errors
        /// What the operating system says.
        pub(crate) fn open() -> io::Result<Self> {
            let device_end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
            grantpt(&device_end)?;
            unlockpt(&device_end)?;
            let path = ptsname(&device_end, Vec::new())?.into_string().map_err(io::Error::other)?;
            // Opened and closed once, the terminal says from then on whether a host has it open.
            let host_end = rustix::fs::open(path.as_str(), OFlags::RDWR | OFlags::NOCTTY, Mode::empty())?;
            let mut settings = tcgetattr(&host_end)?;
            settings.make_raw();
            tcsetattr(&host_end, OptionalActions::Now, &settings)?;
            let flags = rustix::fs::fcntl_getfl(&device_end)?;
            rustix::fs::fcntl_setfl(&device_end, flags | OFlags::NONBLOCK)?;
            Ok(Self { device_end: File::from(device_end), path })
        }

        /// Whether a host has the other end open. Without one, what is written is lost, as on a serial line.
        #[must_use]
        pub(crate) fn has_host(&self) -> bool {
            let mut asked = [PollFd::new(&self.device_end, PollFlags::OUT)];
            let now = Timespec { tv_sec: 0, tv_nsec: 0 };
            poll(&mut asked, Some(&now)).is_ok() && !asked[0].revents().contains(PollFlags::HUP)
        }
    }
}
