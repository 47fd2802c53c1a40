//! Files that commands take, read whole and understood.

use std::error::Error;
use std::fmt::Display;
use std::fs;
use std::io::{self, Read as _};
use std::path::Path;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::geometry::bounding_box;
use palpate::pushing::dynamics::Body;
use palpate_files::body::BodyFileError;
use palpate_files::lines::{Line, Lines, TEXT_BYTES_MAX, Unusable};
use palpate_files::motion::MotionFileError;
use palpate_files::palm::PalmFileError;
use palpate_files::part::{Doubt, PartFileError};
use palpate_files::passing::PassingFileError;
use palpate_files::scene::SceneFileError;
use palpate_files::shapes::Opener;
use palpate_files::views::ViewFileError;

use crate::recording;
use crate::width::folded;

/// Most problems of a file that are printed; their number always is.
const PROBLEMS_SHOWN: usize = 10;

/// Prints what of a file was skipped.
pub(super) fn report_problems(path: &Path, problems: &[impl Display]) {
    for problem in problems.iter().take(PROBLEMS_SHOWN) {
        tracing::warn!("{}: {problem}", path.display());
    }
    if problems.len() > PROBLEMS_SHOWN {
        tracing::warn!("{}: … {} problems in all", path.display(), problems.len());
    }
}

/// Reads a file and understands it; what goes wrong is told with the file's name.
pub(super) fn read<T, E>(path: &Path, parse: impl FnOnce(&str) -> Result<T, E>) -> miette::Result<T>
where
    E: Error + Send + Sync + 'static,
{
    read_kind(path, wanted, parse)
}

/// The same of a kind of file whose errors are those of other kinds, too.
pub(super) fn read_kind<T, E>(
    path: &Path,
    wanted: impl Fn(&E) -> &'static [&'static str],
    parse: impl FnOnce(&str) -> Result<T, E>,
) -> miette::Result<T>
where
    E: Error + Send + Sync + 'static,
{
    let cannot = || format!("cannot use {}", path.display());
    let text = read_text(path)
        .map_err(|error| if is_from_cad(path) { given_from_cad(path, &error.to_string(), &[]) } else { error })
        .wrap_err_with(cannot)?;
    recording::attach(kind_of(&text).map_or("file", role), path, text.as_bytes());
    parse(&text)
        .map_err(|error| {
            let kind = kind_of(&text).filter(|kind| !wanted(&error).is_empty() && !wanted(&error).contains(kind));
            match kind {
                Some(kind) => {
                    let help = format!("{kind} is given where {} is asked for", wanted(&error).join(" or "));
                    miette::miette!(help = help, "{error}")
                }
                None if is_from_cad(path) && kind_of(&text).is_none() => {
                    given_from_cad(path, "it is no TOML", wanted(&error))
                }
                None => crate::advice::report(error),
            }
        })
        .wrap_err_with(cannot)
}

/// Reads a file that may name others, beside it, and understands it.
pub(super) fn read_beside<T, E>(path: &Path, parse: impl FnOnce(&str, Opener<'_>) -> Result<T, E>) -> miette::Result<T>
where
    E: Error + Send + Sync + 'static,
{
    read(path, |text| parse(text, &|name| open_beside(path, name)))
}

/// Opens what a file names: a path from the folder that the file is in.
pub(super) fn open_beside(path: &Path, name: &str) -> io::Result<Vec<u8>> {
    let beside = path.parent().unwrap_or(Path::new("")).join(name);
    let bytes = drawing_bytes(&beside)?;
    recording::attach(DRAWING, &beside, &bytes);
    Ok(bytes)
}

/// The text of a file as it is kept elsewhere: a drawing that it names is named from the root of the file system.
pub(super) fn kept_elsewhere(path: &Path, text: String) -> String {
    let Ok(mut keys) = text.parse::<toml::Table>() else { return text };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = match keys.get_mut("outline") {
        Some(toml::Value::Table(outline)) => outline.get_mut("file"),
        other => other,
    };
    let Some(toml::Value::String(file)) = file else { return text };
    match fs::canonicalize(folder.join(&*file)) {
        Ok(whole) => *file = whole.to_string_lossy().into_owned(),
        Err(_) => return text,
    }
    keys.to_string()
}

/// What a drawing is called in a recording.
pub(super) const DRAWING: &str = "drawing";

/// Longest drawing read, in bytes: a solid of the most facets that are taken, as text.
const DRAWING_BYTES_MAX: u64 = 512 << 20;

/// The bytes of a drawing.
pub(super) fn drawing_bytes(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    fs::File::open(path)?.take(DRAWING_BYTES_MAX + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > DRAWING_BYTES_MAX {
        return Err(io::Error::other(format!("it is longer than {} MiB: export it coarser", DRAWING_BYTES_MAX >> 20)));
    }
    Ok(bytes)
}

/// Whether a file's name is that of a drawing or a solid from CAD.
pub(super) fn is_from_cad(path: &Path) -> bool {
    let is = |ending: &&str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending));
    ["dxf", "svg", "stl"].iter().any(is)
}

/// A file from CAD where one is asked for that may name it.
fn given_from_cad(path: &Path, error: &str, wanted: &[&str]) -> miette::Report {
    let asked = if wanted.is_empty() { "a file in TOML".to_owned() } else { wanted.join(" or ") };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let place = match wanted {
        [SCENE] => "a scene names it in a [[shape]]",
        _ => "a part file names it",
    };
    let help = format!(
        "a file from CAD is given where {asked} is asked for: {place}, as `outline = {{ file = {name:?} }}` (docs/SHAPES.md)"
    );
    miette::miette!(help = help, "{error}")
}

/// What a person's file is, by its keys; none where it may be anything.
fn kind_of(text: &str) -> Option<&'static str> {
    let keys: toml::Table = text.parse().ok()?;
    let has = |names: &[&str]| names.iter().any(|name| keys.contains_key(*name));
    match () {
        () if has(&["segment"]) => Some(MOTION),
        () if has(&["harmonic", "piece"]) => Some(PALM),
        () if has(&["cone", "fence", "point"]) => Some(VIEWS),
        () if has(&["barrier", "beam"]) => Some(BEAMS),
        () if keys.get("shape").is_some_and(toml::Value::is_array) => Some(SCENE),
        () if has(&["shape", "semi_axes"]) => Some(BODY),
        () if has(&["vertices", "ellipse", "outline"]) => Some(PART),
        () => None,
    }
}

/// What a kind of file is called in a recording.
fn role(kind: &'static str) -> &'static str {
    match kind {
        MOTION => "motion",
        PALM => "palm",
        PART => "part",
        BODY => "body",
        _ => "file",
    }
}

const MOTION: &str = "a motion file";
const PALM: &str = "a palm's motion";
pub(super) const VIEWS: &str = "a view file";
const BEAMS: &str = "a file of beams";
const SCENE: &str = "a scene";
const BODY: &str = "a body file";
const PART: &str = "a part file";

/// What kinds of file an error is about.
fn wanted<E: Error + 'static>(error: &E) -> &'static [&'static str] {
    let error: &(dyn Error + 'static) = error;
    match () {
        () if error.is::<PartFileError>() => &[PART],
        () if error.is::<MotionFileError>() => &[MOTION],
        () if error.is::<BodyFileError>() => &[BODY],
        () if error.is::<PalmFileError>() => &[PALM],
        () if error.is::<SceneFileError>() => &[SCENE],
        () if error.is::<PassingFileError>() => &[BEAMS],
        // The same error is told of both.
        () if error.is::<ViewFileError>() => &[PART, VIEWS],
        () => &[],
    }
}

/// Says what was read of a part, and warns of what is possible, but rarely meant.
pub(super) fn tell_part(path: &Path, outline: &[Point2<f64>], body: &Body, doubts: &[Doubt]) {
    note!("{}", folded(&format!("{}: {}", path.display(), part_in_words(outline, body))));
    for doubt in doubts {
        tracing::warn!("{}: {doubt}", path.display());
    }
}

/// Size, area, centre of mass and how far the mass is from it.
fn part_in_words(outline: &[Point2<f64>], body: &Body) -> String {
    let (low, high) = bounding_box(outline);
    let size = (high - low) * 1e3;
    let next = outline.iter().cycle().skip(1);
    let area = 0.5 * outline.iter().zip(next).map(|(a, b)| a.coords.perp(&b.coords)).sum::<f64>();
    let centre = body.centre_of_mass() * 1e3;
    format!(
        "{:.1} × {:.1} mm, {:.2} cm², centre of mass at ({:.1}, {:.1}) mm, radius of gyration {:.1} mm",
        size.x,
        size.y,
        area * 1e4,
        centre.x,
        centre.y,
        body.inertia_per_mass().sqrt() * 1e3
    )
}

/// The lines of standard input with their number, as text or why not.
pub(super) fn lines_of_stdin() -> impl Iterator<Item = io::Result<(u64, Result<String, Unusable>)>> {
    let lines = Lines::new(io::stdin().lock(), TEXT_BYTES_MAX);
    lines.map(|line| line.map(|Line { number, content }| (number, content.into_text())))
}

/// Longest file read, in bytes: some twenty minutes of forces at 4 kHz.
const FILE_BYTES_MAX: u64 = 256 << 20;

/// The text of a file without its byte-order mark.
pub(super) fn read_text(path: &Path) -> miette::Result<String> {
    let mut text = String::new();
    let file = fs::File::open(path).into_diagnostic()?;
    file.take(FILE_BYTES_MAX + 1).read_to_string(&mut text).into_diagnostic()?;
    if text.len() as u64 > FILE_BYTES_MAX {
        let help = "give a shorter recording, or the right file";
        return Err(miette::miette!(help = help, "it is longer than {} MiB", FILE_BYTES_MAX >> 20));
    }
    if text.starts_with(BYTE_ORDER_MARK) {
        text.drain(..BYTE_ORDER_MARK.len_utf8());
    }
    Ok(text)
}

/// What some programs write before the text.
const BYTE_ORDER_MARK: char = '\u{feff}';

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_another_kind_is_recognised() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("given.toml");
        let part = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [0, 40]]\nmu = 0.3";
        let motion = "unit = 'mm'\n[[segment]]\nseconds = 1\nacceleration = [100, 0]";
        let help = |text: &str, part: bool| {
            fs::write(&path, text).unwrap();
            let error = match part {
                true => read(&path, palpate_files::part::PartFile::parse).map(drop).unwrap_err(),
                false => read(&path, palpate_files::motion::parse).map(drop).unwrap_err(),
            };
            error.help().map(|help| help.to_string())
        };
        assert_eq!(help(motion, true).as_deref(), Some("a motion file is given where a part file is asked for"));
        assert_eq!(help(part, false).as_deref(), Some("a part file is given where a motion file is asked for"));
        assert_eq!(help(&part.replace("mu", "muu"), true), None);
    }

    #[test]
    fn a_file_from_cad_is_recognised_where_another_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let help = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            fs::write(&path, bytes).unwrap();
            read(&path, palpate_files::part::PartFile::parse).map(drop).unwrap_err().help().unwrap().to_string()
        };
        let drawing = help("a.dxf", b"0\nSECTION\n");
        assert!(drawing.starts_with("a file from CAD is given where a part file is asked for"), "{drawing}");
        assert!(drawing.contains("`outline = { file = \"a.dxf\" }`"), "{drawing}");
        // Not even text.
        assert!(help("a.STL", &[0xff; 84]).contains("`outline = { file = \"a.STL\" }`"));
    }

    #[test]
    fn a_byte_order_mark_is_no_text_and_an_endless_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        fs::write(&path, "\u{feff}t,Fx,Fy\n").unwrap();
        assert_eq!(read_text(&path).unwrap(), "t,Fx,Fy\n");
        #[cfg(target_os = "linux")]
        assert!(read_text(Path::new("/dev/zero")).unwrap_err().to_string().contains("longer than 256 MiB"));
    }
}
