//! Slow pushes that were recorded: how well the estimator of slow pushes finds the part.
//!
//! Folders of pushing logs are read ([`palpate_files::recordings::slow_pushes`]); what the part stood on is in each
//! folder's name. `tasks` says what the estimator is told and lets it answer; here the answers are counted: several seeds,
//! of which the worst is shown, beside the bars.
//!
//! Units: as the columns' headings say. Errors: [`RealError`].

mod figures;
mod summary;
mod tasks;

use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use nalgebra::Point2;
use palpate::geometry::SimplePolygon;
use palpate::pushing::estimation::slow_pushes::{
    BLOCK_EDGE_FRICTIONS, FilterSettings, KnownLog, KnownPush, PushParameters, SlowConstants, SlowScene, Standing,
    calibrated, edge_frictions,
};
use palpate_files::recordings::slow_pushes::{MeasuredPush, of_pushes, standing};
use palpate_files::recordings::{Format, mlab, text};

pub(crate) use self::summary::table;
pub(crate) use self::tasks::Answer;
use self::tasks::{Judge, RealLog};
use super::cases;
use crate::pictures::plot::Figure;

/// The block of the recordings: right-angled, legs of 150 mm.
const BLOCK_M: [[f64; 2]; 3] = [[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]];
/// Its centre of mass, m.
const CENTRE_OF_MASS_M: [f64; 2] = [0.05, 0.05];
/// Its mass, kg.
const MASS_KG: f64 = 1.518;

/// Radius of the fingertip as it was made, m.
const TIP_RADIUS_M: f64 = 1e-3;

/// What is drawn: everything once for each of so many seeds, one after the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seeds {
    pub(crate) first: u64,
    pub(crate) count: usize,
}

/// Why recordings give no table.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RealError {
    #[error("cannot read {}: {error}", place.display())]
    Unreadable { place: PathBuf, error: std::io::Error },
    #[error("{} has no pushing log: expected a folder named `patch` or x1_x2_x3_y1_y2_y3 (feet in mm) with a log in it, or a folder of such folders", place.display())]
    NoLog { place: PathBuf },
    #[error("{}: {message}", place.display())]
    Bad { place: PathBuf, message: String },
}

/// A log, what the part stood on in it, and the model.
struct Readied {
    log: RealLog,
    standing: Standing,
    /// The finger's friction on each of the block's edges, in that of all.
    edge_frictions: Vec<f64>,
    scene: SlowScene,
}

/// The model of a log, changed.
type Change = dyn Fn(&Readied) -> Option<SlowScene>;

/// Recordings that can be judged, each with the part on what it stood on.
pub(crate) struct Recordings {
    logs: Vec<Readied>,
    /// What could not be read, and was left out.
    pub(crate) problems: Vec<String>,
}

impl Recordings {
    /// Reads folders of logs, or folders of such folders.
    pub(crate) fn read(folders: &[PathBuf]) -> Result<Self, RealError> {
        let mut recordings = Self { logs: Vec::new(), problems: Vec::new() };
        for folder in folders {
            let before = recordings.logs.len();
            // A path like `.` has no name of its own.
            let named = folder.canonicalize().unwrap_or_else(|_| folder.clone());
            if let Some(standing) = told_by(&named) {
                recordings.add(&named, &standing)?;
            } else {
                let inner = entries(folder)?;
                for (inner, standing) in inner.iter().filter_map(|inner| Some((inner, told_by(inner)?))) {
                    recordings.add(inner, &standing)?;
                }
            }
            if recordings.logs.len() == before {
                return Err(RealError::NoLog { place: folder.clone() });
            }
        }
        Ok(recordings)
    }

    /// Adds the logs of a folder.
    fn add(&mut self, folder: &Path, standing: &Standing) -> Result<(), RealError> {
        let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let mut logs = Vec::new();
        for file in entries(folder)?.into_iter().filter(|file| file.is_file()) {
            let bytes = fs::read(&file).map_err(|error| RealError::Unreadable { place: file.clone(), error })?;
            let Ok(text) = text(&bytes) else { continue };
            if Format::detect(&text) == Format::Mlab {
                let bad = |message: String| RealError::Bad { place: file.clone(), message };
                let log = mlab::parse(&text).map_err(|error| bad(error.to_string()))?;
                self.problems.extend(log.bad().map(|problem| format!("{}: {problem}", file.display())));
                logs.push((file, log));
            }
        }
        let several = logs.len() > 1;
        for (file, log) in logs {
            let stem = file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
            let pushes = of_pushes(&log, Point2::from(CENTRE_OF_MASS_M), &FilterSettings::STANDARD);
            let log = RealLog { name: if several { format!("{name}/{stem}") } else { name.clone() }, pushes };
            let message = "feet on one line cannot bear the block".to_owned();
            let edge_frictions = BLOCK_EDGE_FRICTIONS.to_vec();
            let scene = scene(standing, SlowConstants::BOARD, &edge_frictions);
            let scene = scene.ok_or(RealError::Bad { place: folder.to_owned(), message })?;
            self.logs.push(Readied { log, standing: standing.clone(), edge_frictions, scene });
        }
        Ok(())
    }

    /// Fits the set-up's constants anew for each log, from the others. What no other log tells, a face's pressure among
    /// feet, stays as it was fitted on the board.
    pub(crate) fn leave_one_out(&mut self) {
        let known = |log: &RealLog| log.pushes.iter().map(|push| push.known.clone()).collect::<Vec<_>>();
        let pushes: Vec<_> = self.logs.iter().map(|log| known(&log.log)).collect();
        let fitted: Vec<_> = (0..self.logs.len()).map(|left_out| self.fitted_without(left_out, &pushes)).collect();
        for (log, fitted) in self.logs.iter_mut().zip(fitted) {
            if let Some((scene, edge_frictions)) = fitted {
                (log.scene, log.edge_frictions) = (scene, edge_frictions);
            }
        }
    }

    /// The model of a log with its edges' frictions, all fitted to the pushes of the other logs.
    fn fitted_without(&self, left_out: usize, pushes: &[Vec<KnownPush>]) -> Option<(SlowScene, Vec<f64>)> {
        let others = self.logs.iter().zip(pushes).enumerate().filter(|(number, _)| *number != left_out);
        let others: Vec<_> = others.map(|(_, (log, pushes))| KnownLog { standing: &log.standing, pushes }).collect();
        let outline = SimplePolygon::new(BLOCK_M.map(Point2::from)).ok()?;
        let centre = Point2::from(CENTRE_OF_MASS_M);
        let from = SlowConstants { pressure_rise: SlowConstants::BOARD.pressure_rise, ..SlowConstants::UNFITTED };
        let frictions = edge_frictions(&outline, centre, &others, &from);
        let stride = FilterSettings::STANDARD.stride;
        let constants = calibrated(&outline, centre, MASS_KG, &others, &frictions, from, stride);
        Some((scene(&self.logs[left_out].standing, constants, &frictions)?, frictions))
    }

    /// How far predictions from the pose before are off, with one thing of the model changed at a time: m and rad.
    pub(crate) fn ablation(&self) -> Vec<(&'static str, Vec<[f64; 2]>)> {
        let changed = |change: fn(&mut SlowConstants)| {
            move |log: &Readied| {
                let mut constants = *log.scene.constants();
                change(&mut constants);
                scene(&log.standing, constants, &log.edge_frictions)
            }
        };
        let rows: [(&str, Box<Change>); 6] = [
            ("full model", Box::new(|log| Some(log.scene.clone()))),
            (
                "no tip calibration",
                Box::new(changed(|c| (c.tip_ahead, c.tip_left, c.radius) = (0.0, 0.0, TIP_RADIUS_M))),
            ),
            ("ellipsoid", Box::new(|log| Some(log.scene.ellipsoidal()))),
            ("uniform face", Box::new(changed(|c| c.pressure_rise = 0.0))),
            ("path as logged", Box::new(changed(|c| c.beyond_log = 0.0))),
            ("no load transfer", Box::new(changed(|c| c.height = 0.0))),
        ];
        let errors = |scene: &Change| {
            let of_log = |log: &Readied| {
                let scene = scene(log);
                let error = move |push: &MeasuredPush| {
                    let known = &push.known;
                    let stride = FilterSettings::STANDARD.stride;
                    let none = PushParameters::default();
                    let pose = scene.as_ref()?.simulate(&known.felt, &known.before, &none, stride).pose;
                    Some(tasks::error(&pose, &known.after))
                };
                log.log.pushes.iter().filter_map(error).collect::<Vec<_>>()
            };
            self.logs.iter().flat_map(of_log).collect()
        };
        rows.into_iter().map(|(name, scene)| (name, errors(scene.as_ref()))).collect()
    }

    /// All answers of so many seeds; `tell` gets them in order as they are made.
    pub(crate) fn answers(
        &self,
        seeds: Seeds,
        jobs: NonZeroUsize,
        mut tell: impl FnMut(&[Answer]) + Send,
    ) -> Vec<Answer> {
        let per_log = seeds.count * TASKS.len();
        let answered = cases::of_each_in_order(
            self.units(seeds),
            jobs,
            |unit| {
                let Readied { log, scene, .. } = &self.logs[unit / per_log];
                let (seed, task) = (seeds.first + ((unit % per_log) / TASKS.len()) as u64, TASKS[unit % TASKS.len()]);
                let judge = Judge { log, scene, settings: FilterSettings::STANDARD, seed, log_seed: hash(&log.name) };
                task(&judge)
            },
            |answers: &Vec<Answer>| tell(answers.as_slice()),
        );
        answered.into_iter().flatten().collect()
    }

    /// Pictures of these answers: what is not explained by log, place and direction, and the blind chain with the worst
    /// answer around it.
    pub(crate) fn figures(&self, answers: &[Answer]) -> Vec<(String, Figure)> {
        let mut figures = vec![("real-errors".to_owned(), figures::errors(&self.logs, answers))];
        let worst = answers.iter().filter(|answer| answer.task == "d" && answer.push > figures::SETTLED);
        let worst = worst.max_by(|a, b| figures::size(a).total_cmp(&figures::size(b)));
        let log = worst.and_then(|worst| self.logs.iter().find(|log| log.log.name == worst.log).zip(Some(worst)));
        if let Some((Readied { log, scene, .. }, worst)) = log {
            let judge =
                Judge { log, scene, settings: FilterSettings::STANDARD, seed: worst.seed, log_seed: hash(&log.name) };
            figures.push(("real-film".to_owned(), figures::film(&judge, worst.push)));
        }
        figures
    }

    /// Pieces of work.
    pub(crate) fn units(&self, seeds: Seeds) -> usize {
        self.logs.len() * seeds.count * TASKS.len()
    }

    /// The logs' names.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> + Clone {
        self.logs.iter().map(|log| log.log.name.as_str())
    }
}

/// What is asked of each log under each seed.
const TASKS: [fn(&Judge<'_>) -> Vec<Answer>; 5] = [
    |judge| judge.start_given(),
    |judge| judge.start_given_and_learned(),
    |judge| judge.start_in_a_box(),
    |judge| judge.start_unknown(),
    |judge| judge.blind(),
];

/// The block on what it stands on, with the finger's friction on each of its edges.
fn scene(standing: &Standing, constants: SlowConstants, edge_frictions: &[f64]) -> Option<SlowScene> {
    let outline = SimplePolygon::new(BLOCK_M.map(Point2::from)).ok()?;
    let scene = SlowScene::new(&outline, Point2::from(CENTRE_OF_MASS_M), MASS_KG, standing, constants)?;
    Some(scene.with_edge_frictions(edge_frictions))
}

fn told_by(folder: &Path) -> Option<Standing> {
    standing(folder.file_name()?.to_str()?).ok().filter(|_| folder.is_dir())
}

/// What is in a folder, by name.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, RealError> {
    let unreadable = |error| RealError::Unreadable { place: folder.to_owned(), error };
    let entries = fs::read_dir(folder).map_err(unreadable)?.filter_map(|entry| Some(entry.ok()?.path()));
    let mut entries: Vec<_> = entries.collect();
    entries.sort();
    Ok(entries)
}

/// FNV-1a: a number for a name, the same everywhere.
fn hash(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
