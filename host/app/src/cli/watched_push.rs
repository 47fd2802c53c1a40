//! A push watched from its first sample to its end: live from a device, or from a file of forces.
//!
//! Either way samples go through the same judge and the same [`PushWatch`].

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use miette::WrapErr as _;
use nalgebra::{Rotation2, Vector2};
use palpate::finger::calibration::{Calibration, FrontEnd};
use palpate::finger::contact::{Reading, TareError};
use palpate::finger::judge::{CountsJudge, ForceJudge, Judged};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::dynamics::FingerShape;
use palpate::pushing::estimation::from_rest::onset::PushSense;
use palpate::pushing::estimation::from_rest::readings::KnownOfFinger;
use palpate::pushing::estimation::from_rest::watch::{PushAnswer, PushWatch, RecordedWatch, WatchSettings};
use palpate::pushing::estimation::from_rest::{CarriedFinger, KnownFromRest, WindowedForce};
use palpate::pushing::finger_motion::FingerMotion;
use palpate::pushing::streamed_path::StreamedPath;
use palpate_device::Session;
use palpate_device::session::{Incoming, InputLevels};
use palpate_files::calibration::carried::ComplianceRecord;
use palpate_files::calibration::file::CalibrationFile;
use palpate_files::part::PolygonFile;

use super::calibrated::FingerArguments;
use super::kept_push::KeptPush;
use super::motion_source::{AskedMotion, MotionSource};
use super::semi_axes::SemiAxes;
use super::switches::BOARD_INPUTS;
use super::told_tables::TableArguments;
use super::{lacking, positive};
use crate::advice::{self, Advise as _};
use crate::live;
use crate::live::interrupt;
use crate::recording;
use crate::threads::PATIENT;

/// Where a push comes from.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct WatchedPushArguments {
    /// Forces on the finger from a file instead of a device: a table of t, Fx, Fy, with the finger at rest at its
    /// beginning
    #[arg(value_name = "FORCES", conflicts_with_all = ["device", "baud", "calibration", "record", "speed"])]
    pub(super) forces: Option<PathBuf>,

    #[command(flatten)]
    pub(super) felt: FeltPushArguments,

    /// Keep what is felt in this folder: forces.csv, rest included, and motion.toml, to be looked at again
    #[arg(long, value_name = "DIR", conflicts_with = "forces")]
    keep: Option<PathBuf>,

    #[command(flatten)]
    finger: FingerArguments,

    #[command(flatten)]
    pub(super) tables: TableArguments,
}

/// What must be known of the finger, its rest and the plane to make sense of the forces.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct FeltPushArguments {
    /// Radius of the finger's disk
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 15.0)]
    radius_mm: f64,

    /// Semi-axes of a finger that is an ellipse and no disk, along the x and y of the motion
    #[arg(long, value_name = "MM,MM", value_parser = SemiAxes::parse, conflicts_with = "radius_mm")]
    semi_axes_mm: Option<SemiAxes>,

    /// Take the tare over so many seconds at rest, at the beginning
    #[arg(long, value_name = "S", default_value_t = 1.0, allow_negative_numbers = true, value_parser = super::stretch)]
    tare: f64,

    /// How well the part file's mu is known: 20% as one standard deviation, x2 for within a factor of two (two of
    /// them), or exact. Unless it is exact, mu is found too [default: 20%; of `palpate friction` x3]
    #[arg(long, value_name = "SHARE", value_parser = MuUncertainty::parse, allow_hyphen_values = true)]
    mu_uncertainty: Option<MuUncertainty>,

    /// At which angle the robot's x axis lies in the finger's, in degrees, as `palpate wave` says ("mounted"): the motion is
    /// told and the pose named along the robot's axes then [default: 0, the finger's own]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = super::finite)]
    mounting_deg: Option<f64>,

    /// What the finger feels of its own mass when it accelerates, in grams: VALUE or VALUE,SIGMA (without SIGMA known to
    /// 5 %; 0 for forces that are free of it) [default: what `palpate wave` found, or else 20 ± 20 g, found with the rest]
    #[arg(long, value_name = "G", value_parser = effective_mass)]
    effective_mass_g: Option<EffectiveMass>,

    /// How far the finger's tip gives way, µm/N: VALUE or VALUE,SIGMA (without SIGMA known to a tenth) [default: the
    /// calibration's, or else 0]
    #[arg(long, value_name = "UM/N", value_parser = super::wave::compliance, allow_hyphen_values = true)]
    compliance_um_per_n: Option<ComplianceRecord>,

    /// How well it is known where the disk is on the robot, one standard deviation of each coordinate: what `palpate
    /// locate-tip` stated [default: the calibration's, or else 0, poses counting from the disk]
    #[arg(long, value_name = "MM", value_parser = super::not_negative, allow_negative_numbers = true)]
    tip_sigma_mm: Option<f64>,
}

/// An effective mass as told, kg.
#[derive(Clone, Copy, Debug, PartialEq)]
struct EffectiveMass {
    mass: f64,
    sd: f64,
}

/// A mass in grams, with or without its standard deviation.
fn effective_mass(text: &str) -> Result<EffectiveMass, String> {
    let neither = || format!("{text:?} is neither VALUE nor VALUE,SIGMA in grams, 0 or more");
    let grams = |text: &str| text.trim().parse::<f64>().ok().filter(|grams| (0.0..=MASS_MAX_G).contains(grams));
    let (mass, sd) = match text.split_once(',') {
        Some((mass, sd)) => (grams(mass), grams(sd)),
        None => (grams(text), grams(text).map(|mass| TOLD_SHARE * mass)),
    };
    let (mass, sd) = mass.zip(sd).ok_or_else(neither)?;
    Ok(EffectiveMass { mass: mass * 1e-3, sd: sd * 1e-3 })
}

/// What the scale of a force may be off by since it was calibrated, as a share: gauges and bridge drift by 300 ppm/K, and a room
/// is some 5 K warmer or colder another day. The part's mass takes it up.
const SCALE_SD: f64 = 0.0015;

/// Axes that differ by less than this are one, degrees: of a push of 2 cm the end is a third of a millimetre off.
const ALIGNED_DEG: f64 = 1.0;

/// And a difference counts that is so many times what it may be off.
const ALIGNED_SDS: f64 = 3.0;

/// How well a mass is taken to be known that is told without more.
const TOLD_SHARE: f64 = 0.05;

/// No finger is heavier, g.
const MASS_MAX_G: f64 = 10_000.0;

/// What is known of a push but for the part and the motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct FeltPush {
    arguments: FeltPushArguments,
    finger: CarriedFinger,
}

/// How the finger moves, told.
#[derive(Debug, clap::Args)]
pub(super) struct MotionArgument {
    /// How the finger moves: a motion file (see `palpate observe --help`), or - for segments from standard input
    #[arg(long = "motion", value_name = "MOTION.toml")]
    pub(super) file: PathBuf,
}

impl FeltPushArguments {
    /// Of the disk, m.
    pub(super) fn radius(&self) -> f64 {
        self.radius_mm * 1e-3
    }

    /// The outline of a finger that is no disk.
    pub(super) fn shape(&self) -> Option<FingerShape> {
        self.semi_axes_mm.map(SemiAxes::shape)
    }

    /// Refuses a finger that is no disk, for what knows only disks.
    pub(super) fn check_disk(&self) -> miette::Result<()> {
        match self.semi_axes_mm {
            None => Ok(()),
            Some(_) => Err(miette::miette!(
                help = "leave --semi-axes-mm out, or use `palpate observe` without --method",
                "this works with a finger's disk only, not with an ellipse"
            )),
        }
    }

    /// Rest at the beginning, s.
    pub(super) fn tare(&self) -> f64 {
        self.tare
    }

    /// Where the robot's x axis lies in the finger's, rad.
    pub(super) fn mounting(&self) -> f64 {
        self.mounting_deg.unwrap_or(0.0).to_radians()
    }

    /// Whether the friction of the plane is told as exact.
    pub(super) fn mu_is_exact(&self) -> bool {
        self.mu_uncertainty.is_some_and(|told| told.log_sd.is_none())
    }

    /// How well the friction of the plane is known.
    pub(super) fn mu_g_log_sd(&self) -> Option<f64> {
        self.mu_uncertainty.unwrap_or(MuUncertainty::UNTOLD).log_sd
    }

    /// Says so where the calibration knows that the axes differ and nobody has.
    fn tell_mounting(&self, calibration: &CalibrationFile) {
        let Some(wave) = calibration.wave.as_ref().filter(|_| self.mounting_deg.is_none()) else { return };
        if wave.mounting_deg.abs() > ALIGNED_DEG.max(ALIGNED_SDS * wave.mounting_sigma_deg) {
            tracing::warn!(
                "the calibration has the robot's x axis at {:+.1}° in the finger's: if the motion is told along the robot's \
                 axes, say --mounting-deg {:.1}; if along the finger's, --mounting-deg 0",
                wave.mounting_deg,
                wave.mounting_deg
            );
        }
    }

    /// With what a calibration says of the finger, where there is one; what is only taken for it is told.
    pub(super) fn with(self, calibration: Option<&CalibrationFile>) -> FeltPush {
        let mut finger = calibration.map_or(CarriedFinger::UNKNOWN, CalibrationFile::carried);
        calibration.into_iter().for_each(|file| self.tell_mounting(file));
        if let Some(EffectiveMass { mass, sd }) = self.effective_mass_g {
            (finger.effective_mass, finger.effective_mass_sd) = (mass, sd);
        } else if calibration.is_none_or(|file| file.wave.is_none()) {
            let [mass, sd] = [finger.effective_mass, finger.effective_mass_sd].map(|mass| mass * 1e3);
            note!(
                "the finger's own mass is not known: taken for {mass:.0} ± {sd:.0} g and found with the rest; \
                 `palpate wave` measures it, --effective-mass-g tells it"
            );
        }
        if let Some(compliance) = self.compliance_um_per_n {
            [finger.compliance, finger.compliance_sd] =
                [compliance.um_per_n, compliance.sigma_um_per_n].map(|value| value * 1e-6);
        }
        if let Some(sigma_mm) = self.tip_sigma_mm {
            finger.place_sd = sigma_mm * 1e-3;
        }
        if finger.place_sd > 0.0 {
            note!("the tip's place is known to {:.3} mm, which every pose states with the rest", finger.place_sd * 1e3);
        }
        if finger.compliance > 0.0 {
            let [um_per_n, sd] = [finger.compliance, finger.compliance_sd].map(|value| value * 1e6);
            note!("the tip gives way by {um_per_n:.1} ± {sd:.1} µm/N: so does the pose, as uncertainly");
        }
        FeltPush { arguments: self, finger }
    }
}

impl FeltPush {
    /// A finger about to rest and then to push, along the robot's axes, of which an estimate is due so often; a tare of a
    /// finger under load is refused where its front-end is given.
    pub(super) fn watch(&self, every_s: f64, calibration: &Calibration, front_end: Option<FrontEnd>) -> PushWatch {
        let settings = WatchSettings { rest_s: self.arguments.tare, every_s };
        let calibration = calibration.mounted(self.arguments.mounting()).with_scale_sd(SCALE_SD);
        let watch = PushWatch::new(settings, Some(&calibration)).carried(self.finger);
        match front_end {
            Some(front_end) => watch.behind(front_end),
            None => watch,
        }
    }

    /// Of the finger's disk, m.
    pub(super) fn radius(&self) -> f64 {
        self.arguments.radius()
    }

    /// The finger as it is carried.
    pub(super) fn carried(&self) -> CarriedFinger {
        self.finger
    }

    /// What is known of the finger, as options of a command line.
    fn told(&self) -> String {
        let CarriedFinger { effective_mass, effective_mass_sd, compliance, compliance_sd, place_sd } = self.finger;
        let [mass, sd] = [effective_mass, effective_mass_sd].map(|mass| mass * 1e3);
        let mut told = format!(" --effective-mass-g {mass:.3},{sd:.3}");
        if compliance > 0.0 {
            told += &format!(" --compliance-um-per-n {:.2},{:.2}", compliance * 1e6, compliance_sd * 1e6);
        }
        if place_sd > 0.0 {
            told += &format!(" --tip-sigma-mm {:.4}", place_sd * 1e3);
        }
        if let Some(degrees) = self.arguments.mounting_deg {
            told += &format!(" --mounting-deg {degrees}");
        }
        told
    }

    /// What is known of a push from rest of the part in this file, with this motion of the finger.
    pub(super) fn known<'a>(self, file: &'a PolygonFile, motion: &'a FingerMotion) -> KnownFromRest<'a> {
        let Self { arguments, finger } = self;
        let (mu_g, mu_g_log_sd) = (file.mu * GRAVITY_ASSUMED, arguments.mu_g_log_sd());
        let radius = arguments.radius();
        let shape = arguments.shape();
        KnownFromRest {
            part: &file.part,
            errors: file.errors.if_any(),
            mu_g,
            mu_g_log_sd,
            radius,
            shape,
            finger,
            motion,
        }
    }

    /// The same for readings of which each has this noise, N.
    pub(super) fn known_of_finger<'a>(
        self,
        file: &'a PolygonFile,
        motion: &'a FingerMotion,
        noise: f64,
    ) -> KnownOfFinger<'a> {
        let CarriedFinger { effective_mass, effective_mass_sd, compliance, compliance_sd, place_sd } = self.finger;
        let (mu_g, radius) = (file.mu * GRAVITY_ASSUMED, self.arguments.radius());
        let known = KnownOfFinger::new(&file.part, mu_g, radius, motion, noise);
        let mu_g_log_sd = self.arguments.mu_g_log_sd();
        KnownOfFinger {
            shape: self.arguments.shape(),
            errors: file.errors.if_any(),
            mu_g_log_sd,
            effective_mass,
            effective_mass_sd,
            compliance,
            compliance_sd,
            place_sd,
            ..known
        }
    }
}

/// How well the friction of the plane is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MuUncertainty {
    /// Standard deviation of its logarithm; none where it is known.
    pub(super) log_sd: Option<f64>,
}

impl MuUncertainty {
    /// Where nothing is said of it: measured by tilting the table until the part slides, µ varies by about as much from
    /// place to place and from day to day. Taken for exact, a µ that is 20 % off turns a pose by degrees, with an
    /// uncertainty stated in tenths of one.
    pub(super) const UNTOLD: Self = Self { log_sd: Some(0.2) };

    /// Where it is to be measured: within a factor of three, two standard deviations. Dry plastics, wood, paper and metals are
    /// between 0.1 and 0.9.
    pub(super) const UNMEASURED: Self = Self { log_sd: Some(0.55) };

    pub(super) fn parse(text: &str) -> Result<Self, String> {
        match text {
            "exact" => Ok(Self { log_sd: None }),
            text => log_sd(text).map(|sd| Self { log_sd: Some(sd) }),
        }
    }
}

/// A share in per cent as the standard deviation of a logarithm, or a factor as two of them.
fn log_sd(text: &str) -> Result<f64, String> {
    let neither = || format!("{text:?} is neither a share such as 20%, nor a factor such as x2, nor exact");
    let within = |value: &str, limits: [f64; 2], unit: &str| {
        let value: f64 = value.parse().map_err(|_| neither())?;
        let [low, high] = limits;
        if (low..=high).contains(&value) {
            Ok(value)
        } else {
            Err(format!("{text} is not within {low}{unit} and {high}{unit}"))
        }
    };
    match (text.strip_suffix('%'), text.strip_prefix(['x', '×'])) {
        (Some(share), _) => within(share.trim_end(), PER_CENT, "%").map(|share| share / 100.0),
        (None, Some(factor)) => within(factor.trim_start(), FACTOR, "").map(|factor| 0.5 * factor.ln()),
        (None, None) => Err(neither()),
    }
}

/// What the friction of a plane can be uncertain by: less than the first is nothing beside other errors, more than the
/// second is a factor.
const PER_CENT: [f64; 2] = [0.1, 100.0];

/// The same as a factor: at more than the second mu would be no guess at all.
const FACTOR: [f64; 2] = [1.01, 10.0];

/// The usable rows of a file of forces, judged; the others are named.
fn judged_forces(path: &Path, tables: &TableArguments) -> miette::Result<Vec<Judged>> {
    Ok(ForceJudge::judge_recording(&tables.forces(path)?.readings))
}

/// A push that is over.
pub(super) struct WatchedPush {
    pub(super) watch: PushWatch,
    motion: FingerMotion,
    felt: FeltPush,
}

/// When a board's digital inputs first changed while a push was awaited, s on the clock of what is felt.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct InputsSeen {
    levels: Option<u8>,
    first: [Option<f64>; BOARD_INPUTS],
}

impl InputsSeen {
    /// Takes what a board tells; what changes before the tare is taken counts for nothing.
    fn take(&mut self, inputs: &InputLevels, counts: bool) {
        let changed = self.levels.replace(inputs.levels).map_or(0, |before| before ^ inputs.levels);
        let changed = |input: &usize| counts && changed >> input & 1 == 1;
        for input in (0..BOARD_INPUTS).filter(changed) {
            self.first[input].get_or_insert(inputs.time_us as f64 * 1e-6);
        }
    }

    /// Of an input, 0 to 7.
    pub(super) fn first_change(&self, input: usize) -> Option<f64> {
        self.first.get(input).copied().flatten()
    }
}

/// A push while it goes on.
pub(super) struct Ongoing<'w> {
    pub(super) watch: &'w mut PushWatch,
    pub(super) felt: FeltPush,
    /// As far as it is told.
    pub(super) motion: &'w FingerMotion,
    /// The measured places that tell it, if such do.
    pub(super) path: Option<&'w StreamedPath>,
    is_told_to_its_end: bool,
    /// Of the device; none where it is a file of forces.
    pub(super) session: Option<&'w mut Session>,
    /// Of its board.
    pub(super) inputs: InputsSeen,
}

impl Ongoing<'_> {
    /// Whether nothing more is to come of a push from rest.
    pub(super) fn is_over(&self) -> bool {
        self.watch.is_over(self.motion, self.is_told_to_its_end)
    }

    /// Whether the finger's motion is over that began then, on the clock of what is felt, s.
    pub(super) fn is_motion_over(&self, begun: f64) -> bool {
        let now = self.watch.sense().map_or(f64::NEG_INFINITY, PushSense::now);
        self.is_told_to_its_end && now >= begun + self.motion.duration()
    }

    /// Goes on until nothing more is to come.
    pub(super) fn until_over(&mut self) -> miette::Result<ControlFlow<()>> {
        Ok(if self.is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    }
}

/// What is asked of a push whenever something came: whether to go on.
pub(super) type Look<'l> = &'l mut dyn FnMut(&mut Ongoing<'_>) -> miette::Result<ControlFlow<()>>;

/// What of a recording is watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Watched {
    /// The rest, and the contact that lasts as long as the finger's motion, or else the longest.
    Push,
    /// Everything after the rest.
    Everything,
}

/// How a push is watched.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watching {
    /// An estimate is due every so many seconds.
    pub(super) every_s: f64,
    pub(super) watched: Watched,
}

impl Watching {
    /// A push that is looked at when it is over.
    pub(super) const TO_ITS_END: Self = Self { every_s: f64::INFINITY, watched: Watched::Push };
}

impl WatchedPushArguments {
    /// Begins the recording that is asked for, before the files of the command are read.
    pub(super) fn begin_recording(&self) -> miette::Result<()> {
        self.finger.device.begin_recording()
    }

    /// The same, of which the friction of the plane is known so well where nothing is said of it.
    pub(super) fn with_mu_uncertainty(&self, untold: MuUncertainty) -> Self {
        let mu_uncertainty = self.felt.mu_uncertainty.or(Some(untold));
        Self { felt: FeltPushArguments { mu_uncertainty, ..self.felt }, ..self.clone() }
    }

    /// Watches a push, the finger moving as this file says, to look at it when it is over.
    pub(super) fn watch_to_its_end(&self, motion: &Path) -> miette::Result<WatchedPush> {
        self.watch(AskedMotion::Told(motion), Watching::TO_ITS_END, &mut |ongoing| ongoing.until_over())
    }

    /// Watches a push, the finger moving as is told there, until `look` has seen enough.
    pub(super) fn watch(
        &self,
        motion: AskedMotion<'_>,
        watching: Watching,
        look: Look<'_>,
    ) -> miette::Result<WatchedPush> {
        let settings = WatchSettings { rest_s: self.felt.tare, every_s: watching.every_s };
        let mut motion = MotionSource::open(motion, &self.tables, self.finger.device.is_recording())?;
        let (felt, watch) = match &self.forces {
            Some(path) => {
                let felt = self.felt.with(None);
                let named = || format!("cannot use the forces {}", path.display());
                let judged: Vec<_> =
                    judged_forces(path, &self.tables)?.into_iter().map(|it| it.mounted(self.felt.mounting())).collect();
                motion.read_all()?;
                let Some(known) = motion.known() else { return Err(motion.lacks()) };
                let watch = RecordedWatch::new(PushWatch::new(settings, None).carried(felt.finger), &judged, known);
                let watch = watch.map_err(not_at_rest).wrap_err_with(named)?;
                let of_push = (&judged[..], known, motion.path(), felt);
                (felt, watch_recording(watch, watching.watched, of_push, look).wrap_err_with(named)?)
            }
            None => self.watch_device(settings, &mut motion, look)?,
        };
        let Some(motion) = motion.known().cloned() else { return Err(motion.lacks()) };
        if let Some(sense) = watch.sense() {
            tell_contacts(sense, motion.duration());
        }
        lacking::tell("since the push began", &watch.tally());
        Ok(WatchedPush { watch, motion, felt })
    }

    fn watch_device(
        &self,
        settings: WatchSettings,
        motion: &mut MotionSource,
        look: Look<'_>,
    ) -> miette::Result<(FeltPush, PushWatch)> {
        interrupt::listen();
        let mut kept = self.keep.as_deref().map(KeptPush::begin).transpose()?;
        let mut session = self.finger.device.open(true)?;
        let (_, file) = self.finger.calibration.require_file(&session)?;
        let (calibration, felt) = (file.calibration().advised()?, self.felt.with(Some(&file)));
        live::start(&mut session).advised()?;
        note!("{}taring for {} s: no force on the finger", super::simulated_note(&session), self.felt.tare);
        let front_end = live::front_end(session.hello()).advised()?;
        let is_checked = self.finger.offset.expected(&calibration, &front_end).is_some();
        let mounting = self.felt.mounting();
        let mut watch = felt.watch(settings.every_s, &calibration, is_checked.then_some(front_end));
        let mut judge = CountsJudge::new(&calibration);
        let mut failed = None;
        let mut inputs = InputsSeen::default();
        recording::tared(calibration.unit().symbol(), None);
        let mut take = |watch: &mut PushWatch, session: &mut Session, incoming: &Incoming, judged: Vec<Judged>| {
            let was_resting = watch.sense().is_none();
            if let Incoming::Inputs(levels) = incoming {
                inputs.take(levels, !was_resting);
            }
            if let Some(kept) = &mut kept {
                kept.take(&judged, was_resting, watch.onset_time().is_some());
            }
            watch.take(judged.into_iter().map(|it| it.mounted(mounting))).map_err(not_at_rest)?;
            motion.take(session)?;
            if let Some(sense) = watch.sense().filter(|_| was_resting) {
                let bias = Rotation2::new(mounting) * sense.rest().bias;
                recording::tared(calibration.unit().symbol(), Some(bias));
                note!("ready: push");
            }
            let Some(known) = motion.known() else { return Ok(ControlFlow::Continue(())) };
            look(&mut Ongoing {
                watch,
                felt,
                motion: known,
                path: motion.path(),
                is_told_to_its_end: motion.is_complete(),
                session: Some(session),
                inputs,
            })
        };
        let watched = live::judged(&mut session, &mut judge, |session, incoming, judged| {
            super::tell(incoming);
            let taken = take(&mut watch, session, incoming, judged);
            let goes_on = matches!(taken, Ok(ControlFlow::Continue(())));
            failed = taken.err();
            goes_on
        });
        // Whatever ended it, nobody listens any more.
        let stopped = session.stop();
        if let (Some(kept), Some(motion)) = (&kept, motion.known()) {
            kept.save(motion, &felt.told())?;
        }
        watched.advised()?;
        failed.map_or(Ok(()), Err)?;
        stopped.advised()?;
        Ok((felt, watch))
    }
}

/// Watches what is left of a recording after its rest.
fn watch_recording(
    recorded: RecordedWatch,
    watched: Watched,
    (judged, motion, path, felt): (&[Judged], &FingerMotion, Option<&StreamedPath>, FeltPush),
    look: Look<'_>,
) -> miette::Result<PushWatch> {
    let RecordedWatch { mut watch, rested, from, push, others } = recorded;
    let from = match watched {
        Watched::Push => from,
        Watched::Everything => rested,
    };
    if let Some(push) = push.filter(|_| watched == Watched::Push) {
        for other in others {
            note!(
                "a contact from t = {:.3} s to {:.3} s is not taken for the push, which begins at t = {:.3} s",
                other.from,
                other.to,
                push.from
            );
        }
    }
    for item in &judged[from..] {
        watch.take([*item]).map_err(not_at_rest)?;
        let (is_told_to_its_end, inputs) = (true, InputsSeen::default());
        let mut ongoing = Ongoing { watch: &mut watch, felt, motion, path, is_told_to_its_end, session: None, inputs };
        if look(&mut ongoing)?.is_break() {
            break;
        }
    }
    Ok(watch)
}

impl WatchedPush {
    /// What is known of the push if this part was pushed.
    pub(super) fn known<'p>(&'p self, file: &'p PolygonFile) -> KnownFromRest<'p> {
        self.felt.known(file, &self.motion)
    }

    /// The force that was felt.
    pub(super) fn force(&self) -> miette::Result<WindowedForce> {
        self.was_felt()?;
        self.watch.force(&self.motion).ok_or_else(too_short)
    }

    /// What is known in the end, if it is this part.
    pub(super) fn conclude(&mut self, file: &PolygonFile) -> Option<PushAnswer> {
        let known = self.felt.known(file, &self.motion);
        self.watch.conclude(&known, &PATIENT)
    }

    /// What was felt since the push began, tared: s since then, and N on the finger; in mean over these many seconds.
    pub(super) fn since_onset(&self, mean_s: f64) -> Vec<(f64, Vector2<f64>)> {
        let readings = self.watch.sense().map_or(&[][..], PushSense::readings);
        let stretch = |t: f64| (t / mean_s).floor();
        let stretches = readings.chunk_by(|a, b| (stretch(a.t) - stretch(b.t)).abs() < 0.5);
        let middle = |readings: &[Reading]| {
            let count = readings.len() as f64;
            let t = readings.iter().map(|reading| reading.t).sum::<f64>() / count;
            (t, readings.iter().map(|reading| reading.force_finger).sum::<Vector2<f64>>() / count)
        };
        stretches.map(middle).collect()
    }

    /// How the finger moved.
    pub(super) fn motion(&self) -> &FingerMotion {
        &self.motion
    }

    /// Of the finger's own mass, kg.
    pub(super) fn effective_mass(&self) -> f64 {
        self.felt.finger.effective_mass
    }

    /// When contact was lost before the motion's end, s since the push began.
    pub(super) fn lost(&self) -> Option<f64> {
        let sense = self.watch.sense()?;
        Some(sense.lost_before(self.motion.duration())? - sense.onset_time()?)
    }

    /// Whether there was a push at all.
    pub(super) fn was_felt(&self) -> miette::Result<()> {
        if self.watch.onset_time().is_some() {
            return Ok(());
        }
        Err(without_push())
    }
}

/// Where nothing was felt.
pub(super) fn without_push() -> miette::Report {
    miette::miette!(
        help = "the force must stand out of the noise by far: is the part too light, or did the finger not touch it?",
        "no push was felt"
    )
}

/// Of a push that says nothing.
pub(super) fn too_short() -> miette::Report {
    miette::miette!(
        help = "push for longer: a tenth of a second says little, half a second much",
        "the push was too short to say anything"
    )
}

/// Says what was felt beside the push: contacts that were too short, and an end before the motion's.
fn tell_contacts(sense: &PushSense, duration: f64) {
    for knock in sense.knocks() {
        note!("a knock at t = {:.3} s was too short to be the push", knock.from);
    }
    if let (Some(onset), Some(lost)) = (sense.onset_time(), sense.lost_before(duration)) {
        note!(
            "contact was lost at t = {lost:.3} s, {:.3} s after the push began; the motion lasts {duration:.3} s",
            lost - onset
        );
    }
}

/// What to tell where the stretch for the tare was no rest.
pub(super) fn not_at_rest(error: TareError) -> miette::Report {
    let help = advice::help(&error).unwrap_or_default();
    let help = format!("{help}; if the rest before the push was shorter than the tare, say so with --tare");
    let help = help.trim_start_matches("; ");
    miette::miette!(help = help, "the finger was not at rest while the tare was taken: {error}")
}
