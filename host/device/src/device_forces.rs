//! Forces that a device computes, held against the samples that they are of, by the same function.
//!
//! A force follows its block, so the last block is enough. Units: µN on the wire, N for users. Errors: none.

use palpate_shared::wire::{Block, ForceMatrix, MeanForce};

use crate::session::{DeviceForce, ForceCheck};

/// Newtons in a µN.
const N_PER_UN: f64 = 1e-6;

/// What a device was asked for, and what came of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct DeviceForces {
    /// The matrix that it keeps.
    pub(crate) matrix: Option<ForceMatrix>,
    /// Whether it sends forces.
    pub(crate) is_on: bool,
    /// How they compared.
    pub(crate) check: ForceCheck,
    last: Option<Block>,
}

impl DeviceForces {
    /// The matrix that a device which starts anew is to get again.
    pub(crate) fn wanted(&self) -> Option<ForceMatrix> {
        self.matrix.filter(|_| self.is_on)
    }

    /// Another tare, in sixteenths of a count.
    pub(crate) fn tare(&mut self, tare: [i32; 2]) {
        self.matrix = self.matrix.map(|matrix| ForceMatrix { tare, ..matrix });
    }

    /// Keeps a block, as it came, for the force that follows it.
    pub(crate) fn remember(&mut self, block: &Block) {
        self.last = self.is_on.then(|| block.clone());
    }

    /// Holds a force against its block.
    pub(crate) fn take(&mut self, force: &MeanForce, time_us: u64) -> DeviceForce {
        let is_its = |block: &&Block| block.first == force.first && block.samples.len() == usize::from(force.samples);
        let block = self.last.as_ref().filter(is_its);
        let own = self.matrix.zip(block).and_then(|(matrix, block)| matrix.force_un(block.samples.iter().copied()));
        let agrees = own.map(|own| own == force.force_un);
        *match agrees {
            Some(true) => &mut self.check.equal,
            Some(false) => &mut self.check.different,
            None => &mut self.check.unchecked,
        } += 1;
        let force_finger = force.force_un.map(|un| f64::from(un) * N_PER_UN);
        DeviceForce { time_us, force_finger, status: force.status, agrees }
    }
}
