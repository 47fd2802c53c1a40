//! What a live push had to go by, kept as files: `--keep DIR` of the commands that watch a push.

use std::fs;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Vector2;
use palpate::finger::contact::Reading;
use palpate::finger::judge::Judged;
use palpate::pushing::finger_motion::FingerMotion;
use palpate_files::{motion, output};

/// The files of a kept push: what was felt, bias and rest included, and how the finger moved.
pub(super) const FORCES: &str = "forces.csv";
/// See [`FORCES`].
pub(super) const MOTION: &str = "motion.toml";

/// So many readings are kept of a finger that waits, ten minutes at 4 kHz: of a longer wait the beginning, where the rest is,
/// and the end.
const READINGS_MAX: usize = 2_400_000;

/// A push that is kept as it is felt.
#[derive(Debug)]
pub(super) struct KeptPush {
    folder: PathBuf,
    readings: Vec<Reading>,
    /// Readings at the beginning that belong to the rest.
    rest: usize,
}

impl KeptPush {
    /// Into a folder that has none of the files yet: found out before anything is pushed.
    pub(super) fn begin(folder: &Path) -> miette::Result<Self> {
        check_new(folder, &[FORCES, MOTION])?;
        Ok(Self { folder: folder.to_owned(), readings: Vec::new(), rest: 0 })
    }

    /// Takes what was measured; whether the tare is still being taken, and whether the push has begun.
    pub(super) fn take(&mut self, judged: &[Judged], is_resting: bool, is_pushed: bool) {
        self.readings.extend(judged.iter().copied().filter_map(Judged::reading));
        if is_resting {
            self.rest = self.readings.len();
        } else if !is_pushed && self.readings.len() > READINGS_MAX {
            let waited = self.rest..self.readings.len() - READINGS_MAX / 2;
            self.readings.drain(waited);
        }
    }

    /// Writes the files; `told` is how a command line repeats what was known of the finger.
    pub(super) fn save(&self, motion: &FingerMotion, told: &str) -> miette::Result<()> {
        let forces = as_table(self.readings.iter().map(|reading| (reading.t, reading.force_finger)));
        write_new(&self.folder, &[(FORCES, &forces), (MOTION, &motion::to_text(motion))])?;
        let named = |name: &str| self.folder.join(name).display().to_string();
        note!("kept; to look again: {} --motion {}{told}", named(FORCES), named(MOTION));
        Ok(())
    }
}

/// Whether a folder has none of these files yet.
fn check_new(folder: &Path, names: &[&str]) -> miette::Result<()> {
    match names.iter().find(|name| folder.join(name).exists()) {
        Some(name) => {
            let help = "name a new folder, or move the file away";
            Err(miette::miette!(help = help, "there is a {name} already")).wrap_err_with(|| cannot(folder))
        }
        None => Ok(()),
    }
}

fn cannot(folder: &Path) -> String {
    format!("cannot keep the push in {}", folder.display())
}

/// Writes files that are not there yet.
pub(super) fn write_new(folder: &Path, files: &[(&str, &str)]) -> miette::Result<()> {
    let names: Vec<_> = files.iter().map(|(name, _)| *name).collect();
    check_new(folder, &names)?;
    fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| cannot(folder))?;
    files
        .iter()
        .try_for_each(|(name, text)| output::write_new(&folder.join(name), text.as_bytes()))
        .into_diagnostic()
        .wrap_err_with(|| cannot(folder))
}

/// Forces as a table of t, Fx, Fy.
pub(super) fn as_table(forces: impl Iterator<Item = (f64, Vector2<f64>)>) -> String {
    let rows = forces.map(|(t, force)| format!("{t:.6}, {:.6}, {:.6}\n", force.x, force.y));
    "t [s], Fx [N], Fy [N]\n".to_owned() + &rows.collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(t: f64) -> Judged {
        Judged::Measured(Reading::new(t, Vector2::new(t, 0.0)))
    }

    #[test]
    fn of_a_long_wait_the_rest_and_what_came_last_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let mut kept = KeptPush::begin(folder.path()).unwrap();
        kept.take(&[at(0.0), at(1.0)], true, false);
        let block: Vec<_> = (0..1000).map(|k| at(2.0 + f64::from(k))).collect();
        let blocks = READINGS_MAX / block.len() + 3;
        (0..blocks).for_each(|_| kept.take(&block, false, false));
        assert!(kept.readings.len() <= READINGS_MAX && kept.readings.len() > READINGS_MAX / 2);
        assert!((kept.readings[1].t - 1.0).abs() < 1e-12 && (kept.readings.last().unwrap().t - 1001.0).abs() < 1e-12);
        // Of a push nothing is left out.
        let before = kept.readings.len();
        (0..blocks).for_each(|_| kept.take(&block, false, true));
        assert_eq!(kept.readings.len(), before + blocks * block.len());
    }

    #[test]
    fn what_is_there_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(MOTION), "mine").unwrap();
        let refused = KeptPush::begin(folder.path()).unwrap_err();
        assert!(format!("{refused:?}").contains("motion.toml"), "{refused:?}");
    }
}
