//! Pictures for people: things on the table and charts, as SVG or PNG. Pure: no files, clocks or fonts of the system.
//!
//! What is to be seen is collected in a [`PlotScene`] (the plane, to scale, in metres) or a [`Chart`] (curves of y over
//! x), put side by side in a [`Figure`], and drawn on a [`Page`]. Both writers draw the same page, text as the outlines
//! of a built-in font, so a picture looks the same on every machine and the SVG has the same bytes.
//!
//! In reading order:
//! - `style`: colours that colour-blind people tell apart, strokes, fills;
//! - `page`: shapes and texts in page units, y down; `font`: the outlines of characters; `svg`, `png`: the writers;
//! - `axis`: round numbers, frames, legends; `scene`, `chart`: what callers fill; `figure`: where it goes on the page.
//!
//! Errors: [`PlotError`], for a picture of impossible size or a file name of another format.

mod axis;
mod chart;
mod figure;
mod font;
mod page;
mod png;
mod scene;
mod style;
mod svg;
#[cfg(test)]
mod tests;

use std::path::Path;

pub use axis::Key;
pub use chart::Chart;
pub use figure::{Figure, Panel};
pub use page::{Anchor, Area, Margins, Page, PagePoint, Text, text_length};
pub use scene::PlotScene;
pub use style::{Colour, Dash, Fill, Stroke, Style};

/// A file format of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Lines and outlines: sharp at every size.
    Svg,
    /// Pixels, two for each page unit.
    Png,
}

impl Format {
    /// The format that a file's name asks for.
    ///
    /// # Errors
    /// [`PlotError::Format`].
    pub fn of(path: &Path) -> Result<Self, PlotError> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(PlotError::Format { name: path.display().to_string() }),
        }
    }
}

/// Why a picture cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlotError {
    /// Not a format that can be written.
    #[error("`{name}` does not end in .svg or .png: pictures are written in these formats")]
    Format {
        /// Name of the file.
        name: String,
    },
    /// No pixels, or too many.
    #[error("a page of {width} by {height} units has no pixels or too many: 1 to 10 000 units a side can be drawn")]
    Size {
        /// Width in page units.
        width: f64,
        /// Height in page units.
        height: f64,
    },
    /// The pixels could not be packed.
    #[error("the picture cannot be packed as PNG: {0}")]
    Encode(String),
}

impl Page {
    /// The bytes of a file of this format.
    ///
    /// # Errors
    /// As [`Page::to_png`].
    pub fn encode(&self, format: Format) -> Result<Vec<u8>, PlotError> {
        match format {
            Format::Svg => Ok(self.to_svg().into_bytes()),
            Format::Png => self.to_png(),
        }
    }
}
