//! Which of the ways to a host is in use, where a board has two.
//!
//! All are listened to, always. The device talks to the host that last sent a sound command, over the link that it came
//! by, and to no other: samples, events and replies all go there. So a host that connects takes over by its first
//! command, noise on a link that nobody uses changes nothing (it would have to pass a CRC-32), and nothing has to be
//! configured.
//! Errors: none.

use palpate_shared::frame::FrameReader;
use palpate_shared::wire::{Command, CommandRead, DecodeError};

/// A way to a host.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Link {
    /// The serial line, which is talked to until a host speaks up on another link.
    #[default]
    Serial,
    /// The USB port, a serial port to the host.
    Usb,
}

/// What is heard on all links, each with half a frame of its own.
#[derive(Default)]
pub(crate) struct Links {
    serial: FrameReader,
    usb: FrameReader,
    in_use: Link,
}

impl Links {
    /// The link that the device talks to.
    pub(crate) const fn in_use(&self) -> Link {
        self.in_use
    }

    /// Listens to a link up to the end of a frame; tells how many bytes that took, and what the frame was.
    pub(crate) fn listen(&mut self, link: Link, bytes: &[u8]) -> (usize, Option<Result<CommandRead, DecodeError>>) {
        let reader = match link {
            Link::Serial => &mut self.serial,
            Link::Usb => &mut self.usb,
        };
        let (taken, frame) = reader.push(bytes);
        (taken, frame.map(|frame| frame.map_err(DecodeError::from).and_then(Command::from_payload)))
    }

    /// A sound command came by this link; tells whether the device talked to another until now.
    pub(crate) fn heard(&mut self, link: Link) -> bool {
        core::mem::replace(&mut self.in_use, link) != link
    }
}
