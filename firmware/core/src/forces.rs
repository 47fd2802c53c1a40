//! Forces computed on the device: the matrix that a host has it keep, and the mean force of each block.
//!
//! The arithmetic is [`ForceMatrix::force_un`], the same as on hosts. The matrix is kept in memory; a board with a store may have
//! found it there at its start. Errors: [`Refusal`].

use palpate_shared::wire::{Block, ForceMatrix, MeanForce, Refusal};

use crate::settings::WithBlocks;

/// What was asked of forces.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Forces {
    matrix: Option<ForceMatrix>,
    is_on: bool,
}

impl Forces {
    /// What a board found in its flash.
    pub(crate) fn found(&mut self, kept: Option<ForceMatrix>) {
        self.matrix = kept;
    }

    /// Keeps a matrix.
    pub(crate) fn keep(&mut self, matrix: ForceMatrix, checksum: u32) -> Result<(), Refusal> {
        if matrix.checksum() != checksum || !matrix.is_sound() {
            return Err(Refusal::MatrixDamaged);
        }
        self.matrix = Some(matrix);
        Ok(())
    }

    /// Takes what the bridges read at rest, in sixteenths of a count.
    pub(crate) fn tare(&mut self, tare: [i32; 2]) -> Result<(), Refusal> {
        let tared = ForceMatrix { tare, ..self.matrix.ok_or(Refusal::NoForceMatrix)? };
        if !tared.is_sound() {
            return Err(Refusal::MatrixDamaged);
        }
        self.matrix = Some(tared);
        Ok(())
    }

    /// Sends forces from now on, or does not.
    pub(crate) fn stream(&mut self, on: bool) -> Result<(), Refusal> {
        if on && self.matrix.is_none() {
            return Err(Refusal::NoForceMatrix);
        }
        self.is_on = on;
        Ok(())
    }

    /// The matrix that is kept.
    pub(crate) fn matrix(&self) -> Option<ForceMatrix> {
        self.matrix
    }

    /// What goes out with each block.
    pub(crate) fn with_blocks(&self) -> WithBlocks {
        if self.is_on { WithBlocks::Forces } else { WithBlocks::Nothing }
    }

    /// The mean force over a block, if forces are asked for.
    pub(crate) fn of(&self, block: &Block) -> Option<MeanForce> {
        let matrix = self.matrix.as_ref().filter(|_| self.is_on)?;
        let force_un = matrix.force_un(block.samples.iter().copied())?;
        let samples = u8::try_from(block.samples.len()).unwrap_or(0);
        Some(MeanForce { first: block.first, time: block.time, samples, status: block.status, force_un })
    }
}
