//! `palpate serve`.

mod feel;
mod observer;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_device::{PlaySpeed, Session};
use palpate_files::part::PolygonFile;

use super::calibrated::{FingerArguments, KeptTare};
use super::lacking;
use super::motion_source::{AskedMotion, MotionSource};
use super::read::{read, tell_part};
use super::tared::{self, Untared};
use super::told_tables::TableArguments;
use super::watched_push::FeltPushArguments;
use crate::advice::Advise as _;
use crate::live::{self, interrupt};
use crate::recording;
use crate::screen::state::{Finger, Recorded};
use crate::web::access::Access;
use crate::web::server::{Board, Server};
use crate::web::shown::{Device, Push, Shown};
use feel::Feel;
use observer::{Known, Observer};

const LONG_HELP: &str = "\
Open the address that is printed in any browser; the page loads nothing from anywhere else. It shows what is felt, force and
angle of the last half minute, losses and the delay, and says plainly what is amiss: no device yet, not tared, settling,
unplugged. Keys on it: t takes a new tare, m sets a mark, p holds the picture still.

With --part and --motion a push is watched as `palpate observe` does: after the tare the finger begins to push, and the part is
drawn wherever it may be, the likelier the darker. A new tare begins another push.

Only this computer is answered. With --bind others are, who bring the token that is printed with the address.

  palpate serve -d sim:7
  palpate serve -d file:run.mcap --part examples/part.toml --motion examples/motion.toml

Exit status: 0, 1 if something cannot be used, 3 if samples were no measurements (saturated, stuck, settling) or the
device started anew, 64 wrong command line.";

/// Shows a finger live in a browser: what it feels, and where the part may be that it pushes.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// Listen at this address of the computer, or all of them with 0.0.0.0; who is not on it needs the token
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST), help_heading = "Page")]
    bind: IpAddr,

    /// Listen at this port; 0 takes one that is free
    #[arg(long, value_name = "PORT", default_value_t = 8686, help_heading = "Page")]
    port: u16,

    /// Answer only who brings this token: letters, digits, - and _, 16 of them at least [default: none on this computer alone,
    /// with --bind a random one]
    #[arg(long, value_name = "TOKEN", value_parser = token, help_heading = "Page", env = "PALPATE_TOKEN", hide_env_values = true)]
    token: Option<String>,

    /// Serve Foxglove's protocol too (Foxglove, Lichtblick, PlotJuggler), at this port of this computer alone, since the protocol
    /// has no token; 0 takes one that is free
    #[cfg(feature = "foxglove")]
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "8765", help_heading = "Page")]
    foxglove: Option<u16>,

    /// The part that is pushed
    #[arg(long, value_name = "PART.toml", requires = "motion", help_heading = "Push")]
    part: Option<PathBuf>,

    /// How the finger moves: a motion file (see `palpate observe --help`), or - for segments from standard input
    #[arg(long, value_name = "MOTION.toml", requires = "part", help_heading = "Push")]
    motion: Option<PathBuf>,

    /// Show an estimate every so many seconds of the push
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = super::positive, help_heading = "Push")]
    every: f64,

    /// Use the tare kept in this file instead of taking one; a push is watched from a rest all the same
    #[arg(long, value_name = "FILE")]
    tare_file: Option<PathBuf>,

    /// Average over so many milliseconds: 20 is a mains period at 50 Hz, 0 is every sample by itself
    #[arg(long, default_value_t = 20.0, value_name = "MS", allow_negative_numbers = true, value_parser = super::not_negative)]
    average_ms: f64,

    /// Friction coefficient between finger and part
    #[arg(long, default_value_t = 0.0, value_name = "MU", allow_negative_numbers = true, value_parser = super::not_negative)]
    mu_c: f64,

    /// Stop after so many seconds of samples [default: until Ctrl-C]
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = super::positive)]
    seconds: Option<f64>,

    #[command(flatten)]
    felt: FeltPushArguments,

    #[command(flatten)]
    finger: FingerArguments,
}

/// A token that an address can carry as it is, and that nobody guesses.
fn token(text: &str) -> Result<String, String> {
    const SHORTEST: usize = 16;
    let is_plain = text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_".contains(&byte));
    match text {
        _ if !is_plain => Err("only letters, digits, - and _ may be in it".to_owned()),
        text if text.len() < SHORTEST => Err(format!("it must have {SHORTEST} characters at least")),
        text => Ok(text.to_owned()),
    }
}

/// Between two attempts to open a device that is not there.
const RETRY: Duration = Duration::from_secs(1);

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    interrupt::listen();
    arguments.finger.device.begin_recording()?;
    let pushed = arguments.pushed()?;
    let mut shown = Shown::default();
    shown.push = pushed.as_ref().map(|(file, motion)| arguments.shown_push(file, motion));
    shown.state.recording = recording::file().map(|file| Recorded {
        file: file.display().to_string(),
        since: None,
        marks: 0,
        goes_on: true,
    });
    let server = arguments.serve(shown)?;
    #[cfg(feature = "foxglove")]
    if let Some(port) = arguments.foxglove {
        let here = Ipv4Addr::LOCALHOST;
        let port = recording::look_on(SocketAddr::new(here.into(), port))?;
        say!("ws://{here}:{port}");
    }
    let Some(session) = arguments.wait_for_device(&server.board())? else { return Ok(ExitCode::SUCCESS) };
    arguments.feel(session, &server, pushed)
}

impl Arguments {
    /// The part that is pushed and how, if one is.
    fn pushed(&self) -> miette::Result<Option<(PolygonFile, MotionSource)>> {
        let (Some(part), Some(motion)) = (&self.part, &self.motion) else { return Ok(None) };
        let file = read(part, PolygonFile::parse)?;
        tell_part(part, file.part.polygon().vertices(), file.part.body(), &file.doubts());
        let tables = TableArguments::default();
        Ok(Some((file, MotionSource::open(AskedMotion::Told(motion), &tables, self.finger.device.is_recording())?)))
    }

    fn shown_push(&self, file: &PolygonFile, motion: &MotionSource) -> Push {
        let start = motion.known().map(|motion| motion.centre(0.0).coords.into());
        Push {
            part: self.part.as_ref().map(|part| part.display().to_string()).unwrap_or_default(),
            outline: file.part.polygon().vertices().iter().map(|vertex| vertex.coords.into()).collect(),
            radius: self.felt.radius(),
            finger: start.unwrap_or_default(),
            ..Push::default()
        }
    }

    /// Serves the page, and tells where.
    fn serve(&self, shown: Shown) -> miette::Result<Server> {
        let token = match &self.token {
            Some(token) => Some(token.clone()),
            None if self.bind.is_loopback() => None,
            None => Some(random_token()?),
        };
        let at = SocketAddr::new(self.bind, self.port);
        let query = token.as_ref().map_or(String::new(), |token| format!("?token={token}"));
        let server = Server::start(at, Access::new(token), shown)
            .map_err(|error| match error.kind() {
                std::io::ErrorKind::AddrInUse => miette::miette!(
                    help =
                        "another program listens there, perhaps another `palpate serve`: choose another --port, or 0",
                    "{error}"
                ),
                std::io::ErrorKind::AddrNotAvailable => miette::miette!(
                    help = "--bind takes an address of this computer, or 0.0.0.0 for all of them",
                    "{error}"
                ),
                _ => miette::miette!("{error}"),
            })
            .wrap_err_with(|| format!("cannot serve the page at {at}"))?;
        let at = server.address();
        if at.ip().is_unspecified() {
            let here = SocketAddr::new(Ipv4Addr::LOCALHOST.into(), at.port());
            say!("http://{here}/{query}");
            note!("from elsewhere: with this computer's name or address in place of {}", here.ip());
        } else {
            say!("http://{at}/{query}");
        }
        Ok(server)
    }

    /// Opens the device, or waits until it can be; `None` where that was to end.
    fn wait_for_device(&self, board: &Board) -> miette::Result<Option<Session>> {
        let can_come = self.finger.device.can_come()?;
        let mut told = String::new();
        while !interrupt::requested() {
            let error = match self.finger.device.open_at(true, PlaySpeed::Times(1.0)) {
                Ok(session) => return Ok(Some(session)),
                Err(error) if !can_come => return Err(error),
                Err(error) => error,
            };
            let why = error.to_string();
            board.update(|shown| shown.device = Device::Missing(why.clone()));
            if told != why {
                let help = error.help().map_or(String::new(), |help| format!("; {help}"));
                note!("no device yet: {why}{help}");
                told = why;
            }
            let again = Instant::now() + RETRY;
            while Instant::now() < again && !interrupt::requested() {
                std::thread::sleep(Duration::from_millis(50));
            }
        }
        Ok(None)
    }

    /// Shows what the finger feels until it is time to stop.
    fn feel(
        &self,
        mut session: Session,
        server: &Server,
        pushed: Option<(PolygonFile, MotionSource)>,
    ) -> miette::Result<ExitCode> {
        let (_, file) = self.finger.calibration.require_file(&session)?;
        let mounting = self.felt.mounting();
        let settings = tared::settings(mounting, self.mu_c, self.average_ms);
        let finger = Untared::new(&session, file.calibration().advised()?, settings, self.finger.offset)?;
        let board = server.board();
        let (observer, motion) = match pushed {
            Some((part, motion)) => {
                let felt = self.felt.with(Some(&file));
                let watch = felt.watch(self.every, &finger.calibration, finger.expected_offset().map(|(_, end)| *end));
                let known = Known { file: part, felt, watch };
                (Some(Observer::start(known, board.clone())?), Some(motion))
            }
            None => (None, None),
        };
        live::start(&mut session).advised()?;
        session.ping().advised()?;
        let kept = match &self.tare_file {
            Some(file) => Some(KeptTare::load(file, &session, finger.unit())?),
            None => None,
        };
        let shown = Finger::of(&session, finger.unit(), finger.front_end.microstrain_per_count());
        board.update(|it| (it.state.finger, it.device) = (shown, Device::Here));
        let mut feel = Feel::new(self, finger, server, observer, motion);
        match kept {
            Some(tare) => feel.put_to_use(&session, tare, true)?,
            None => feel.begin_tare(self.felt.tare()),
        }
        let felt = feel.watch(&mut session);
        // Whatever ended it, nobody listens any more.
        let stopped = session.stop();
        felt?;
        stopped.advised()?;
        super::monitor::tell_counts(&session);
        let lacked = feel.finish();
        lacking::tell("since the tare", &lacked);
        Ok(lacking::status(&lacked))
    }
}

/// 128 random bits, in hexadecimal digits.
fn random_token() -> miette::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).into_diagnostic().wrap_err("the system gives no random numbers for a token")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
