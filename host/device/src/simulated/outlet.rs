//! Where a simulated device's serial line comes out: a pipe in this process, a pseudo-terminal, or TCP.
//!
//! As on a real board, what is sent while no host listens is lost, and nothing here blocks the device.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;

use thiserror::Error;

use crate::Address;
use crate::transport::pipe::Pipe;
#[cfg(unix)]
use crate::transport::platform::pty::Pty;

/// The device's end of its line.
#[derive(Debug)]
pub(super) enum Outlet {
    Pipe(Pipe),
    #[cfg(unix)]
    Pty {
        open: Option<Pty>,
        link: Option<OwnLink>,
    },
    Tcp {
        listener: TcpListener,
        peer: Option<TcpStream>,
        plugged_in: bool,
    },
}

impl Outlet {
    pub(super) fn pipe(pipe: Pipe) -> Self {
        pipe.set_plugged_in(true);
        Self::Pipe(pipe)
    }

    /// A new pseudo-terminal, reachable through the symbolic link `link` where one is given.
    #[cfg(unix)]
    pub(super) fn pty(link: Option<PathBuf>) -> io::Result<Self> {
        let mut outlet = Self::Pty { open: None, link: link.map(OwnLink::at) };
        outlet.plug_in()?;
        Ok(outlet)
    }

    /// Where a line comes out that is no pipe in this process.
    pub(super) fn at(line: &super::Line) -> io::Result<Self> {
        match line {
            super::Line::Pipe => Ok(Self::pipe(Pipe::default())),
            #[cfg(unix)]
            super::Line::Pty { link } => Self::pty(link.clone()),
            #[cfg(not(unix))]
            super::Line::Pty { .. } => {
                let reason = "this system has no pseudo-terminals; use sim: or tcp:";
                Err(io::Error::new(ErrorKind::Unsupported, reason))
            }
            super::Line::Tcp { host } => Self::tcp(host),
        }
    }

    /// A TCP port that one host at a time can connect to.
    pub(super) fn tcp(host: &str) -> io::Result<Self> {
        let listener = TcpListener::bind(host)?;
        listener.set_nonblocking(true)?;
        Ok(Self::Tcp { listener, peer: None, plugged_in: true })
    }

    /// What a host gives as the device's name.
    pub(super) fn address(&self, seed: u64) -> Address {
        match self {
            Self::Pipe(_) => Address::Simulated { seed },
            #[cfg(unix)]
            Self::Pty { link: Some(link), .. } => Address::Serial(link.path.display().to_string()),
            #[cfg(unix)]
            Self::Pty { open, .. } => Address::Serial(open.as_ref().map(|pty| pty.path.clone()).unwrap_or_default()),
            Self::Tcp { listener, .. } => {
                Address::Tcp(listener.local_addr().map(|address| address.to_string()).unwrap_or_default())
            }
        }
    }

    /// Cuts the line, as if its cable were pulled.
    pub(super) fn unplug(&mut self) {
        match self {
            Self::Pipe(pipe) => pipe.set_plugged_in(false),
            #[cfg(unix)]
            Self::Pty { open, .. } => *open = None,
            Self::Tcp { peer, plugged_in, .. } => (*peer, *plugged_in) = (None, false),
        }
    }

    /// Plugs the cable in again. A pseudo-terminal gets a new path; its link, if it has one, then leads there.
    pub(super) fn plug_in(&mut self) -> io::Result<()> {
        match self {
            Self::Pipe(pipe) => pipe.set_plugged_in(true),
            #[cfg(unix)]
            Self::Pty { open, link } => {
                let pty = Pty::open()?;
                if let Some(link) = link {
                    link.lead_to(&pty.path)?;
                }
                *open = Some(pty);
            }
            Self::Tcp { plugged_in, .. } => *plugged_in = true,
        }
        Ok(())
    }

    /// Reads what the host sent; 0 if nothing.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> usize {
        match self {
            Self::Pipe(pipe) => pipe.device_read(buffer),
            #[cfg(unix)]
            Self::Pty { open, .. } => open.as_mut().map_or(0, |pty| pty.device_end.read(buffer).unwrap_or(0)),
            Self::Tcp { listener, peer, plugged_in } => {
                accept(listener, peer, *plugged_in);
                let read = peer.as_mut().map(|peer| peer.read(buffer));
                match read {
                    Some(Ok(0)) => {
                        *peer = None;
                        0
                    }
                    Some(Ok(length)) => length,
                    Some(Err(error)) if error.kind() != ErrorKind::WouldBlock => {
                        *peer = None;
                        0
                    }
                    _ => 0,
                }
            }
        }
    }

    /// Sends as much of `bytes` as the line takes now. Without a host all of it is taken, and lost.
    pub(super) fn write(&mut self, bytes: &[u8]) -> usize {
        match self {
            Self::Pipe(pipe) => pipe.device_write(bytes),
            #[cfg(unix)]
            Self::Pty { open, .. } => match open {
                Some(pty) if pty.has_host() => pty.device_end.write(bytes).unwrap_or(0),
                _ => bytes.len(),
            },
            Self::Tcp { peer, .. } => match peer.as_mut().map(|peer| peer.write(bytes)) {
                Some(Ok(length)) => length,
                Some(Err(error)) if error.kind() == ErrorKind::WouldBlock => 0,
                Some(Err(_)) => {
                    *peer = None;
                    bytes.len()
                }
                None => bytes.len(),
            },
        }
    }
}

/// Lets the next host in when there is none.
fn accept(listener: &TcpListener, peer: &mut Option<TcpStream>, plugged_in: bool) {
    if let Ok((stream, _)) = listener.accept()
        && plugged_in
        && peer.is_none()
        && stream.set_nonblocking(true).is_ok()
    {
        // Slower without, but not wrong.
        let _ = stream.set_nodelay(true);
        *peer = Some(stream);
    }
}

/// Something that this device did not make is where its symbolic link is to be; it is left alone.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{} exists", .0.display())]
pub struct LinkExists(pub PathBuf);

/// A symbolic link that this device made, and may therefore change and remove; any other file is left alone.
#[cfg(unix)]
#[derive(Debug)]
pub(super) struct OwnLink {
    path: PathBuf,
    /// Where it leads, once it is made.
    target: Option<String>,
}

#[cfg(unix)]
impl OwnLink {
    fn at(path: PathBuf) -> Self {
        Self { path, target: None }
    }

    /// Makes the link, or points it elsewhere. A link that leads nowhere is a leftover and is replaced.
    fn lead_to(&mut self, target: &str) -> io::Result<()> {
        let is_leftover = self.path.is_symlink() && !self.path.exists();
        if self.is_ours() || is_leftover {
            std::fs::remove_file(&self.path)?;
        }
        std::os::unix::fs::symlink(target, &self.path).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => io::Error::new(ErrorKind::AlreadyExists, LinkExists(self.path.clone())),
            _ => error,
        })?;
        self.target = Some(target.to_owned());
        Ok(())
    }

    fn is_ours(&self) -> bool {
        let leads_to = std::fs::read_link(&self.path).ok();
        leads_to.is_some() && leads_to.as_deref() == self.target.as_deref().map(std::path::Path::new)
    }
}

#[cfg(unix)]
impl Drop for OwnLink {
    fn drop(&mut self) {
        if self.is_ours() {
            // Somebody else may have removed it in between.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn only_a_link_of_its_own_is_changed_and_removed() {
        let folder = tempfile::tempdir().unwrap();
        let (file, foreign) = (folder.path().join("file"), folder.path().join("foreign"));
        std::fs::write(&file, "kept").unwrap();
        std::os::unix::fs::symlink(&file, &foreign).unwrap();
        for taken in [&file, &foreign] {
            let refused = Outlet::pty(Some(taken.clone())).map(drop).unwrap_err();
            assert!(refused.to_string().contains("exists"), "{refused}");
            assert_eq!(std::fs::read_to_string(taken).unwrap(), "kept");
        }
        let own = folder.path().join("own");
        let mut outlet = Outlet::pty(Some(own.clone())).unwrap();
        assert!(Outlet::pty(Some(own.clone())).is_err(), "a second device does not take the link of a first");
        outlet.unplug();
        outlet.plug_in().unwrap();
        assert!(own.exists());
        drop(outlet);
        assert!(!own.is_symlink());
    }
}
