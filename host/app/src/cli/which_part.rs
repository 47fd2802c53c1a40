//! `palpate which-part`.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use miette::WrapErr as _;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation;
use palpate::pushing::estimation::friction::Told;
use palpate::pushing::estimation::from_rest::WindowedForce;
use palpate::pushing::estimation::planning::{self, Prospect, Rival};
use palpate::pushing::estimation::{
    Belief, Estimate, Hypothesis, Observer as _, PartBelief, PartEstimate, PossiblePart, Shortlist, from_rest,
};
use palpate_files::part::PolygonFile;
use serde::Deserialize;
use serde_json::json;

use super::lacking;
use super::library::part_files;
use super::misfit;
use super::plan_push;
use super::pose;
use super::read::{read, read_beside, tell_part};
use super::watched_push::{MotionArgument, WatchedPush, WatchedPushArguments};
use crate::progress::{self, Progress};
use crate::recording::{self, Believed, Seen};
use crate::threads::{PATIENT, of_each};
use crate::width::folded;

/// Names which of several known parts a finger has begun to push, and where it is.
///
/// Takes the files of `palpate observe` and several part files, or with --library a folder of them. A part file may list several
/// supports (`[[support]]`, with a name and feet each) instead of `feet`: then what the part stands on is named too. Every
/// part is as likely beforehand; how likely it is none of them is told beside, by how well the best one fits. Of a folder
/// only the parts are searched that come near at a first look; it is told how many are left out. How likely it is none of them
/// takes into account that of hundreds one resembles whatever is pushed. Where several parts are possible it is told how the
/// finger should go on, as `palpate plan-push` does: ask again with all that was felt by then.
///
/// Another push of the same part, at another edge, says what one cannot, as that it is none of a library: keep the first
/// answer (`--json > FIRST.json`) and ask with `--earlier FIRST.json` about the second push. Only parts that the first left
/// possible are searched then, and probabilities are of both; the part may have been moved in between, but has to weigh as much.
/// The second answer serves as the earlier one of a third.
///
/// Exit status: 0, also where no part explains the force; 1 if something cannot be used, 3 if samples of the push were no
/// measurements (saturated, stuck, settling) or the device started anew, 64 wrong command line.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// A part file; once for each part that it may be
    #[arg(long = "part", value_name = "PART.toml", required_unless_present = "library")]
    parts: Vec<PathBuf>,

    /// A folder of part files: whatever ends in .toml. A part takes some
    /// hundredths of a second
    #[arg(long, value_name = "DIR", conflicts_with = "parts")]
    library: Option<PathBuf>,

    #[command(flatten)]
    motion: MotionArgument,

    /// What this command said (`--json`) of another push of the same part
    #[arg(long, value_name = "ANSWER.json")]
    earlier: Option<PathBuf>,

    /// Print one JSON object: SI units, radians
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    push: WatchedPushArguments,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    arguments.push.begin_recording()?;
    let candidates = arguments.candidates()?;
    let beforehand = beforehand(&candidates, arguments.earlier.as_deref())?;
    let push = arguments.push.watch_to_its_end(&arguments.motion.file)?;
    let force = push.force()?;
    let tally = push.watch.tally();
    let shortlist = arguments.shortlist(&candidates, &beforehand, &push, &force);
    let known = shortlist.kept.iter().map(|&part| (part, push.known(&candidates[part].file)));
    let (ranked, PartBelief { none, .. }) =
        beforehand.after(known.map(|(part, known)| (part, known.part, known.estimate_until(&force, &PATIENT).found)));
    ranked.iter().for_each(|ranked| {
        let (part, estimate) = (ranked.part, &ranked.estimate);
        let known = push.known(&candidates[part].file);
        let seen = Seen::pushed(known.part, known.motion, known.radius, estimate.time_end);
        recording::believed(Seen { part, ..seen }, estimate.hypotheses.iter().map(Believed::from));
    });
    if arguments.json {
        let mut told = as_json(&candidates, &ranked, none);
        told["samples"] = lacking::as_json(&tally);
        let prospects = next_push(&candidates, &ranked, &push);
        told["next_push"] = prospects.first().filter(|_| separate(&prospects)).map(next_as_json).into();
        if arguments.library.is_some() {
            let left_out = shortlist.left_out.iter();
            told["left_out"] = left_out
                .map(|&(part, misfit)| json!({ "part": candidates[part].path.display().to_string(), "misfit": misfit }))
                .collect();
        }
        say!("{told}");
        return Ok(lacking::status(&tally));
    }
    if let Some(earlier) = &arguments.earlier {
        let (excluded, all) = (candidates.len() - beforehand.possible().count(), candidates.len());
        say!("{}", folded(&format!("Left out are {excluded} of {all}, which {} excludes.", earlier.display())));
    }
    // Of hundreds those that are possible.
    let shown = ranked.iter().filter(|part| arguments.library.is_none() || part.probability > 0.0);
    for part in shown {
        say!("{:6.3}  {}", part.probability, candidates[part.part]);
    }
    if let Some(&(nearest, misfit)) = shortlist.left_out.first() {
        let (left_out, all) = (shortlist.left_out.len(), candidates.len());
        let words = format!(
            "Left out are {left_out} of {all} parts, which at a first look are far from the push, or fit far worse than the \
             best: the nearest of them misfits {misfit:.1} times as badly as noise allows ({}).",
            candidates[nearest]
        );
        say!("{}", folded(&words));
    }
    let Some(first) = ranked.first().filter(|first| first.probability > 0.0) else {
        say!("None of these parts explains what was felt.");
        if let Some(nearest) = nearest(&ranked) {
            let (candidate, fit) = (&candidates[nearest.part], nearest.estimate.fit);
            let mass =
                beforehand.parts[nearest.part].mass.filter(|_| fit.cost.is_some_and(|cost| cost <= fit.cost_max));
            match mass {
                Some(mass) => say!(
                    "{}",
                    folded(&format!(
                        "{candidate} explains this push alone, but not with the {:.1} g that it had by the earlier answer: was the \
                         same part pushed both times, as heavy?",
                        mass.value * 1e3
                    ))
                ),
                None => {
                    let why = misfit::explain(&push.known(&candidate.file), &force);
                    say!("If it is {candidate}, which fits best:\n{why}");
                }
            }
        }
        return Ok(lacking::status(&tally));
    };
    say!("{none:6.3}  none of these; the others are probabilities if it is one of them");
    let candidate = &candidates[first.part];
    say_poses(&format!("If it is {candidate}"), candidate, &first.estimate);
    let possible = ranked.iter().filter(|part| part.probability > 0.0).count();
    if let Some(mixed) = mixed(&candidates, &ranked).filter(|_| possible > 1) {
        say_poses("Whichever it is", candidate, &mixed);
    }
    if possible > 1 {
        let prospects = next_push(&candidates, &ranked, &push);
        say!("{}", folded(&next_in_words(&prospects)));
    } else if arguments.library.is_some() && arguments.earlier.is_none() {
        say!("\n{}", folded(ONE_OF_A_LIBRARY));
    }
    Ok(lacking::status(&tally))
}

/// What is to be known of the only part of a library that explains a push.
const ONE_OF_A_LIBRARY: &str = "A part that is not in the library may feel like one of it at the edge that was pushed. To be sure push it \
    at another edge too, and ask about that push with --earlier and this answer (--json).";

/// Explanations that are told apart by the next push, the likeliest: those beyond are hardly ever true.
const RIVALS_MAX: usize = 12;

/// What motions would tell of the parts that are possible, and of their poses, the best first.
fn next_push(candidates: &[Candidate], ranked: &[PartEstimate], push: &WatchedPush) -> Vec<Prospect> {
    let of_part = |part: &PartEstimate| {
        let known = push.known(&candidates[part.part].file);
        let present = known.present(&part.estimate);
        let probability = part.probability;
        let beliefs: Vec<_> = part.estimate.hypotheses.iter().filter_map(Hypothesis::belief).collect();
        let weighed = move |belief: Belief| Belief { probability: probability * belief.probability, ..belief };
        beliefs.into_iter().map(move |belief| Rival { present, belief: weighed(belief) })
    };
    let mut rivals: Vec<_> = ranked.iter().filter(|part| part.probability > 0.0).flat_map(of_part).collect();
    rivals.sort_by(|a, b| b.belief.probability.total_cmp(&a.belief.probability));
    rivals.truncate(RIVALS_MAX);
    if rivals.len() > 1 { plan_push::prospects_among(&rivals) } else { Vec::new() }
}

/// Whether any motion tells any two explanations apart.
fn separate(prospects: &[Prospect]) -> bool {
    prospects.first().is_some_and(|first| planning::inseparable(prospects).len() < first.pairs.len())
}

fn next_in_words(prospects: &[Prospect]) -> String {
    if prospects.is_empty() {
        return "How to go on cannot be planned: the finger stands still at the end of what was felt, or a place is open."
            .to_owned();
    }
    if !separate(prospects) {
        return "None of the motions that plan-push knows would tell them apart.".to_owned();
    }
    format!("To tell them apart: {}", plan_push::recommended(prospects))
}

fn next_as_json(best: &Prospect) -> serde_json::Value {
    json!({ "motion": best.motion.name, "segments": plan_push::segments_as_json(&best.motion), "risk": best.risk })
}

/// The part with the least misfit.
fn nearest(ranked: &[PartEstimate]) -> Option<&PartEstimate> {
    let costs = ranked.iter().filter_map(|part| Some((part.estimate.fit.cost?, part)));
    costs.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, part)| part)
}

fn say_poses(when: &str, candidate: &Candidate, estimate: &Estimate) {
    let part = &candidate.file.part;
    say!("\n{when}:\n{}", pose::headings());
    pose::lines(part, estimate).iter().for_each(|line| say!("{line}"));
    say!("{}\n{}", pose::legend(part), pose::in_words(part, estimate));
}

/// What `--json` said of another push, as far as it is needed.
#[derive(Debug, Deserialize)]
struct EarlierAnswer {
    parts: Vec<EarlierPart>,
    none_of_these: f64,
}

#[derive(Debug, Deserialize)]
struct EarlierPart {
    part: String,
    support: Option<String>,
    probability: f64,
    estimate: EarlierEstimate,
}

#[derive(Debug, Deserialize)]
struct EarlierEstimate {
    hypotheses: Vec<EarlierHypothesis>,
}

#[derive(Debug, Deserialize)]
struct EarlierHypothesis {
    probability: f64,
    /// kg.
    mass: f64,
    mass_log_sd: f64,
}

/// What is believed before the push: every part is as likely where nothing was said earlier.
fn beforehand(candidates: &[Candidate], earlier: Option<&Path>) -> miette::Result<PartBelief> {
    let Some(path) = earlier else { return Ok(PartBelief::beforehand(candidates.len())) };
    let told = read(path, |text| serde_json::from_str::<EarlierAnswer>(text))
        .wrap_err("--earlier takes what which-part --json said")?;
    let cannot = |why: &str, help: &str| miette::miette!(help = help, "cannot use {}: {why}", path.display());
    let mut all = told.parts.iter().map(|part| part.probability).chain([told.none_of_these]);
    if !all.all(|probability| (0.0..=1.0).contains(&probability)) {
        return Err(cannot("it holds a probability that is not from 0 to 1", "give an answer as it was printed"));
    }
    let mut parts = vec![PossiblePart::default(); candidates.len()];
    for part in told.parts.iter().filter(|part| part.probability > 0.0) {
        let is_it = |candidate: &Candidate| {
            candidate.path.display().to_string() == part.part && candidate.support == part.support
        };
        let place = candidates.iter().position(is_it).ok_or_else(|| {
            let help = "give the parts that were given then, by the same paths";
            cannot(&format!("it may be {}, which is not among the parts", part.part), help)
        })?;
        let found = part.estimate.hypotheses.iter();
        let masses = found.map(|found| (found.probability, Told { value: found.mass, log_sd: found.mass_log_sd }));
        parts[place] = PossiblePart::new(part.probability, masses);
    }
    let belief = PartBelief { parts, none: told.none_of_these };
    if belief.possible().next().is_none() {
        let help = "leave --earlier out to ask about this push alone";
        return Err(cannot("by it the part is none of these already", help));
    }
    Ok(belief)
}

/// A part that it may be.
struct Candidate {
    path: PathBuf,
    support: Option<String>,
    file: PolygonFile,
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        self.support.as_ref().map_or(Ok(()), |support| write!(f, " on {support}"))
    }
}

impl Arguments {
    /// The candidates that are searched: of a library those that come near, of parts named one by one, or that an earlier answer
    /// leaves, all.
    fn shortlist(
        &self,
        candidates: &[Candidate],
        beforehand: &PartBelief,
        push: &WatchedPush,
        force: &WindowedForce,
    ) -> Shortlist {
        if self.library.is_none() || self.earlier.is_some() {
            return Shortlist { kept: beforehand.possible().collect(), left_out: Vec::new() };
        }
        let _progress = Progress::begin("looking which parts come near");
        let done = AtomicU64::new(0);
        let looks = of_each(candidates.len(), |number| {
            let candidate = &candidates[number];
            progress::reached(done.fetch_add(1, Relaxed), candidates.len() as u64, &candidate.to_string());
            from_rest::first_look(&push.known(&candidate.file), force)
        });
        Shortlist::new(&looks)
    }

    fn candidates(&self) -> miette::Result<Vec<Candidate>> {
        let mut all = Vec::new();
        let parts = match &self.library {
            Some(folder) => part_files(folder)?.into_values().collect(),
            None => self.parts.clone(),
        };
        for (number, path) in parts.iter().enumerate() {
            if parts[..number].contains(path) {
                let help = "give each part once: twice it would count as two parts that nothing tells apart";
                return Err(miette::miette!(help = help, "{} is given twice", path.display()));
            }
            let supports = read_beside(path, PolygonFile::parse_supports_beside)?;
            // Of hundreds nobody reads this.
            for (_, file) in supports.iter().filter(|_| self.library.is_none()) {
                tell_part(path, file.part.polygon().vertices(), file.part.body(), &file.doubts());
            }
            let supports = supports.into_iter();
            all.extend(supports.map(|(support, file)| Candidate { path: path.clone(), support, file }));
        }
        if let Some(folder) = &self.library {
            note!("{} parts in {}", parts.len(), folder.display());
        }
        Ok(all)
    }
}

/// One answer of all parts, where those that are possible differ in nothing but what they stand on.
fn mixed(candidates: &[Candidate], ranked: &[PartEstimate]) -> Option<Estimate> {
    let mut possible = ranked.iter().filter(|part| part.probability > 0.0).map(|part| &candidates[part.part].file.part);
    let first = possible.next()?;
    let alike = |part: &Part| {
        part.polygon().vertices() == first.polygon().vertices() && part.centre_of_mass() == first.centre_of_mass()
    };
    possible.all(alike).then(|| estimation::mixed(ranked, from_rest::SAME_PLACE)).flatten()
}

fn as_json(candidates: &[Candidate], ranked: &[PartEstimate], none: f64) -> serde_json::Value {
    let part = |part: &PartEstimate| {
        let candidate = &candidates[part.part];
        let mut told = json!({
            "part": candidate.path.display().to_string(),
            "probability": part.probability,
            "estimate": pose::as_json(&part.estimate),
        });
        if let Some(support) = &candidate.support {
            told["support"] = support.as_str().into();
        }
        told
    };
    let mut answer = json!({
        "parts": ranked.iter().map(part).collect::<Vec<_>>(),
        "none_of_these": none,
    });
    if let Some(mixed) = mixed(candidates, ranked) {
        answer["whichever"] = pose::as_json(&mixed);
    }
    answer
}
