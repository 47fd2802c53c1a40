//! What every command that draws takes: the file to draw to.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_files::output;

use crate::pictures::plot::{Figure, Format};

/// Where to draw.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct PlotArguments {
    /// Draw a picture to this file, .svg or .png
    #[arg(long, value_name = "FILE", value_parser = picture_file)]
    plot: Option<PathBuf>,
}

/// A file name that asks for a format there is, so that a wrong one is refused before anything is computed.
pub(crate) fn picture_file(name: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(name);
    Format::of(&path).map(|_| path).map_err(|error| error.to_string())
}

impl PlotArguments {
    /// Whether a picture was asked for.
    pub(crate) fn is_asked(&self) -> bool {
        self.plot.is_some()
    }

    /// Draws the figure, if a picture was asked for.
    pub(crate) fn draw(&self, figure: impl FnOnce() -> miette::Result<Figure>) -> miette::Result<()> {
        self.plot.as_deref().map_or(Ok(()), |path| draw_to(path, &figure()?))
    }
}

/// Draws to a file that [`picture_file`] has let pass.
pub(crate) fn draw_to(path: &Path, figure: &Figure) -> miette::Result<()> {
    let named = || format!("cannot draw to {}", path.display());
    let picture = Format::of(path).and_then(|format| figure.to_page().encode(format));
    let bytes = picture.into_diagnostic().wrap_err_with(named)?;
    check_replaceable(path).wrap_err_with(named)?;
    output::replace(path, &bytes).into_diagnostic().wrap_err_with(named)?;
    note!("drawn to {}", path.display());
    Ok(())
}

/// A picture may be drawn anew; a file that is no picture is somebody's, perhaps what it is drawn from.
fn check_replaceable(path: &Path) -> miette::Result<()> {
    let mut begin = Vec::new();
    let Ok(there) = fs::File::open(path) else { return Ok(()) };
    let is_file = there.metadata().is_ok_and(|about| about.is_file());
    if !is_file || there.take(PICTURE_BEGINS).read_to_end(&mut begin).is_err() || begin.is_empty() {
        return Ok(());
    }
    let is_picture = begin.starts_with(b"\x89PNG") || begin.starts_with(b"<svg") || begin.starts_with(b"<?xml");
    if is_picture {
        return Ok(());
    }
    Err(miette::miette!(help = "choose another name, or move it away", "it is there and is no picture"))
}

/// Bytes of a file that tell whether it is a picture.
const PICTURE_BEGINS: u64 = 8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_picture_is_drawn_anew() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.svg");
        let figure = Figure::new("nothing", 100.0, 100.0);
        draw_to(&path, &figure).unwrap();
        draw_to(&path, &figure).unwrap();
        fs::write(&path, "unit = 'mm'\n").unwrap();
        let refused = draw_to(&path, &figure).unwrap_err();
        assert!(format!("{refused:?}").contains("no picture"), "{refused:?}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "unit = 'mm'\n");
    }
}
