//! How things are drawn: colours that colour-blind people tell apart, strokes and fills.
//!
//! Units: page units, of which a screen shows 96 an inch.

/// An sRGB colour.
///
/// The named ones are those of Okabe and Ito ("Color Universal Design", 2008), chosen so that people with any kind of
/// colour vision tell them apart; yellow is left out, it is too pale for lines on white.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour {
    /// Red, green and blue.
    pub rgb: [u8; 3],
}

impl Colour {
    /// Text and what matters most.
    pub const BLACK: Self = Self { rgb: [0, 0, 0] };
    /// Captions and frames of panels.
    pub const DARK_GREY: Self = Self { rgb: [80, 80, 80] };
    /// What stays in the background.
    pub const GREY: Self = Self { rgb: [150, 150, 150] };
    /// Grids behind the data.
    pub const PALE_GREY: Self = Self { rgb: [230, 230, 230] };
    /// The page, and rims of text.
    pub const WHITE: Self = Self { rgb: [255, 255, 255] };
    /// Okabe and Ito's blue.
    pub const BLUE: Self = Self { rgb: [0, 114, 178] };
    /// Okabe and Ito's vermillion.
    pub const VERMILLION: Self = Self { rgb: [213, 94, 0] };
    /// Okabe and Ito's bluish green.
    pub const GREEN: Self = Self { rgb: [0, 158, 115] };
    /// Okabe and Ito's reddish purple.
    pub const PURPLE: Self = Self { rgb: [204, 121, 167] };
    /// Okabe and Ito's orange.
    pub const ORANGE: Self = Self { rgb: [230, 159, 0] };
    /// Okabe and Ito's sky blue.
    pub const SKY_BLUE: Self = Self { rgb: [86, 180, 233] };

    /// The same with so much of its ink, from 0, which is white, to 1.
    #[must_use]
    pub fn faded(self, ink: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 255")]
        let faded = |part: u8| (255.0 - (255.0 - f64::from(part)) * ink.clamp(0.0, 1.0)).round() as u8;
        Self { rgb: self.rgb.map(faded) }
    }

    /// Colours for series that have none of their own, in the order in which to use them.
    pub const SERIES: [Self; 6] =
        [Self::BLUE, Self::VERMILLION, Self::GREEN, Self::PURPLE, Self::ORANGE, Self::SKY_BLUE];
}

/// The pattern of a stroke.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dash {
    /// Without any gap.
    Solid,
    /// Dashes longer than the gaps.
    Dashed,
    /// Short dashes, nearly dots.
    Dotted,
}

impl Dash {
    /// Lengths drawn and left out, in stroke widths; none for an unbroken stroke.
    pub(super) fn pattern(self) -> Option<[f64; 2]> {
        match self {
            Self::Solid => None,
            Self::Dashed => Some([5.0, 3.0]),
            Self::Dotted => Some([1.5, 2.0]),
        }
    }
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// Colour of the line.
    pub colour: Colour,
    /// Width of the line, page units.
    pub width: f64,
    /// Pattern of dashes and gaps.
    pub dash: Dash,
}

impl Stroke {
    /// A stroke without gaps, `width` in page units.
    #[must_use]
    pub const fn solid(colour: Colour, width: f64) -> Self {
        Self { colour, width, dash: Dash::Solid }
    }

    /// The same with another pattern.
    #[must_use]
    pub const fn with(self, dash: Dash) -> Self {
        Self { dash, ..self }
    }
}

/// How an area is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    /// Colour of the area.
    pub colour: Colour,
    /// From 0, not to be seen, to 1, hiding what is behind.
    pub opacity: f64,
}

/// A shape's look: nothing is drawn of a shape with neither.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Style {
    /// How its outline is drawn.
    pub stroke: Option<Stroke>,
    /// How its area is filled.
    pub fill: Option<Fill>,
}

impl Style {
    /// An outline without a filled area.
    #[must_use]
    pub const fn line(stroke: Stroke) -> Self {
        Self { stroke: Some(stroke), fill: None }
    }

    /// A filled area without an outline.
    #[must_use]
    pub const fn area(colour: Colour, opacity: f64) -> Self {
        Self { stroke: None, fill: Some(Fill { colour, opacity }) }
    }

    /// The same with an outline.
    #[must_use]
    pub const fn outlined(self, stroke: Stroke) -> Self {
        Self { stroke: Some(stroke), ..self }
    }
}

impl From<Stroke> for Style {
    fn from(stroke: Stroke) -> Self {
        Self::line(stroke)
    }
}
