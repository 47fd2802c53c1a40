//! The thread that is the device.

use std::sync::mpsc::{Receiver, Sender};
use std::time::Instant;

use palpate_shared::sim::{Faults, Load, Script};

use super::outlet::Outlet;
use super::{Config, Moment};

/// An order from the device's owner; each is answered with the moment from which it holds.
#[derive(Debug)]
pub(super) enum Control {
    Load(Load, Sender<Moment>),
    Script(Script, Sender<Moment>),
    Faults(Faults, Sender<Moment>),
    Now(Sender<Moment>),
    Unplug(Sender<Moment>),
    PlugIn(Sender<Moment>),
    Restart(Sender<Moment>),
    Disturb(Vec<u8>, Sender<Moment>),
    End,
}

pub(super) fn run(_config: &Config, _outlet: Outlet, _orders: &Receiver<Control>, _epoch: Instant) {}
