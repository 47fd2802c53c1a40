//! Where a simulated device's serial line comes out: a pipe in this process, a pseudo-terminal, or TCP.
//!
//! As on a real board, what is sent while no host listens is lost, and nothing here blocks the device.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;

use super::pipe::Pipe;
use crate::link::Address;
#[cfg(unix)]
use crate::link::platform::pty::Pty;

/// The device's end of its line.
#[derive(Debug)]
pub(super) enum Outlet {
    Pipe(Pipe),
    #[cfg(unix)]
    Pty {
        open: Option<Pty>,
        link: Option<PathBuf>,
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
        let mut outlet = Self::Pty { open: None, link };
        outlet.plug_in()?;
        Ok(outlet)
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
            Self::Pty { link: Some(link), .. } => Address::Serial(link.display().to_string()),
            #[cfg(unix)]
            Self::Pty { open, .. } => Address::Serial(open.as_ref().map(|pty| pty.path.clone()).unwrap_or_default()),
            Self::Tcp { listener, .. } => {
                Address::Tcp(listener.local_addr().map(|address| address.to_string()).unwrap_or_default())
            }
        }
    }

    /// Pulls the cable.
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
                    replace_link(link, &pty.path)?;
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

/// Points the symbolic link `link` to `target`; a file of another kind there is left alone.
#[cfg(unix)]
fn replace_link(link: &std::path::Path, target: &str) -> io::Result<()> {
    match std::fs::symlink_metadata(link) {
        Ok(there) if there.file_type().is_symlink() => std::fs::remove_file(link)?,
        Ok(_) => return Err(io::Error::new(ErrorKind::AlreadyExists, format!("{} is not a link", link.display()))),
        Err(_) => {}
    }
    std::os::unix::fs::symlink(target, link)
}

#[cfg(unix)]
impl Drop for Outlet {
    fn drop(&mut self) {
        if let Self::Pty { link: Some(link), .. } = self {
            // Somebody else may have removed it.
            let _ = std::fs::remove_file(link);
        }
    }
}
