//! What every command that draws takes: the file to draw to.

use std::fs;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic as _, WrapErr as _};

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
    fs::write(path, bytes).into_diagnostic().wrap_err_with(named)?;
    note!("drawn to {}", path.display());
    Ok(())
}
