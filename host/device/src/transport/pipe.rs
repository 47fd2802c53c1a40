//! Bytes both ways between a simulated device and the host inside one process.
//!
//! It stands in for the serial line where there is no pseudo-terminal, and holds as much as one does.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use crate::transport::READ_WAIT;

/// Bytes that each direction holds before a writer finds no room: what a USB serial driver buffers.
const CAPACITY: usize = 65_536;

/// The bytes under way in one direction.
#[derive(Debug, Default)]
struct Lane {
    bytes: Mutex<VecDeque<u8>>,
    arrived: Condvar,
}

impl Lane {
    fn lock(&self) -> MutexGuard<'_, VecDeque<u8>> {
        // A byte queue is whole between any two operations, whoever panicked.
        self.bytes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes as many bytes as there is room for.
    fn write(&self, bytes: &[u8]) -> usize {
        let mut queue = self.lock();
        let taken = bytes.len().min(CAPACITY - queue.len());
        queue.extend(&bytes[..taken]);
        self.arrived.notify_one();
        taken
    }

    /// Gives what there is, at once.
    fn read(&self, buffer: &mut [u8]) -> usize {
        // Reading from a queue cannot fail.
        self.lock().read(buffer).unwrap_or(0)
    }
}

/// The line between a device and a host. Cutting it is noticed at both ends.
#[derive(Clone, Debug, Default)]
pub struct Pipe {
    to_host: Arc<Lane>,
    to_device: Arc<Lane>,
    state: Arc<Mutex<State>>,
}

#[derive(Debug, Default)]
struct State {
    plugged_in: bool,
    /// Counts the times the cable was plugged in: an end from before is dead.
    plugging: u64,
}

impl Pipe {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Plugs the cable in, or pulls it out; bytes under way are lost.
    pub fn set_plugged_in(&self, plugged_in: bool) {
        let mut state = self.state();
        if state.plugged_in != plugged_in {
            state.plugged_in = plugged_in;
            state.plugging += 1;
            self.to_host.lock().clear();
            self.to_device.lock().clear();
        }
        self.to_host.arrived.notify_all();
    }

    /// The end of the line that a host reads and writes.
    #[must_use]
    pub fn host_end(&self) -> PipeEnd {
        PipeEnd { pipe: self.clone(), plugging: self.state().plugging }
    }

    /// The device writes; gives back how many bytes were taken. Without a cable all are, and are lost.
    #[must_use]
    pub fn device_write(&self, bytes: &[u8]) -> usize {
        if self.state().plugged_in { self.to_host.write(bytes) } else { bytes.len() }
    }

    /// The device reads what there is.
    #[must_use]
    pub fn device_read(&self, buffer: &mut [u8]) -> usize {
        self.to_device.read(buffer)
    }
}

/// The host's end of a pipe: reads like a serial port, with a time limit.
#[derive(Clone, Debug)]
pub struct PipeEnd {
    pipe: Pipe,
    plugging: u64,
}

impl PipeEnd {
    fn check(&self) -> io::Result<()> {
        let state = self.pipe.state();
        if state.plugged_in && state.plugging == self.plugging {
            Ok(())
        } else {
            Err(io::Error::new(io::ErrorKind::BrokenPipe, "the simulated cable is unplugged"))
        }
    }
}

impl Read for PipeEnd {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.check()?;
        let lane = &self.pipe.to_host;
        let waited = lane.arrived.wait_timeout_while(lane.lock(), READ_WAIT, |queue| queue.is_empty());
        let (mut queue, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if queue.is_empty() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        queue.read(buffer)
    }
}

impl Write for PipeEnd {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.check()?;
        match self.pipe.to_device.write(bytes) {
            0 if !bytes.is_empty() => Err(io::ErrorKind::TimedOut.into()),
            taken => Ok(taken),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_cross_in_order_and_a_pulled_cable_is_noticed() {
        let pipe = Pipe::default();
        pipe.set_plugged_in(true);
        let mut host = pipe.host_end();
        assert_eq!(pipe.device_write(b"finger"), 6);
        let mut buffer = [0; 16];
        assert_eq!(host.read(&mut buffer).unwrap(), 6);
        assert_eq!(&buffer[..6], b"finger");
        assert_eq!(host.read(&mut buffer).unwrap_err().kind(), io::ErrorKind::TimedOut);
        pipe.set_plugged_in(false);
        assert_eq!(host.read(&mut buffer).unwrap_err().kind(), io::ErrorKind::BrokenPipe);
        pipe.set_plugged_in(true);
        assert_eq!(host.read(&mut buffer).unwrap_err().kind(), io::ErrorKind::BrokenPipe, "an old end stays dead");
        assert!(pipe.host_end().write(b"x").is_ok());
    }

    #[test]
    fn a_full_pipe_takes_no_more_than_it_holds() {
        let pipe = Pipe::default();
        pipe.set_plugged_in(true);
        assert_eq!(pipe.device_write(&vec![1; CAPACITY + 5]), CAPACITY);
        assert_eq!(pipe.device_write(&[1]), 0);
    }
}
