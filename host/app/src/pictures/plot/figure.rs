//! Panels side by side and one above the other on a page with a title.

use super::axis::TITLE_SIZE;
use super::chart::Chart;
use super::page::{Area, Margins, Page, PagePoint, Text};
use super::scene::PlotScene;
use super::style::Colour;

/// Height of the font of a figure's title and of its subtitle.
const HEADLINE_SIZE: f64 = TITLE_SIZE + 4.0;
const SUBTITLE_SIZE: f64 = TITLE_SIZE - 1.0;

/// Left free at the page's edges, and height of the title and of each line below it.
const EDGE: f64 = 10.0;
const HEADLINE_HEIGHT: f64 = 32.0;
const SUBTITLE_HEIGHT: f64 = 20.0;

/// How much wider a scene is than the charts beside it.
const SCENE_SHARE: f64 = 1.25;

/// What can be drawn into a part of a page.
pub trait Panel {
    /// Draws into an area of a page.
    fn draw(&self, page: &mut Page, panel: Area);
}

/// A page of panels.
pub struct Figure {
    title: String,
    subtitles: Vec<String>,
    size: [f64; 2],
    columns: Vec<Column>,
}

/// Panels one above the other, all of one height.
struct Column {
    share: f64,
    panels: Vec<Box<dyn Panel>>,
}

impl Figure {
    /// An empty figure of a width and a height in page units.
    #[must_use]
    pub fn new(title: impl Into<String>, width: f64, height: f64) -> Self {
        Self { title: title.into(), subtitles: Vec::new(), size: [width, height], columns: Vec::new() }
    }

    /// The figure with a line below its title.
    #[must_use]
    pub fn subtitle(mut self, text: impl Into<String>) -> Self {
        self.subtitles.push(text.into());
        self
    }

    /// The figure with these lines below its title.
    #[must_use]
    pub fn subtitles(self, lines: &[String]) -> Self {
        lines.iter().fold(self, |figure, line| figure.subtitle(line.as_str()))
    }

    /// The figure with a column to the right of those it has: its share of the width, and its panels from the top down.
    #[must_use]
    pub fn column(mut self, share: f64, panels: Vec<Box<dyn Panel>>) -> Self {
        self.columns.push(Column { share, panels });
        self
    }

    /// The figure with one panel to the right of those it has, as wide as any other such panel.
    #[must_use]
    pub fn panel(self, panel: impl Into<Box<dyn Panel>>) -> Self {
        self.column(1.0, vec![panel.into()])
    }

    /// The figure with panels in rows of so many, in the order in which text is read.
    #[must_use]
    pub fn rows(self, across: usize, panels: Vec<Box<dyn Panel>>) -> Self {
        let across = across.min(panels.len()).max(1);
        let mut columns: Vec<Vec<Box<dyn Panel>>> = (0..across).map(|_| Vec::new()).collect();
        let height = panels.len().div_ceil(across);
        let blanks = (panels.len()..across * height).map(|_| Box::new(Blank) as Box<dyn Panel>);
        for (place, panel) in panels.into_iter().chain(blanks).enumerate() {
            columns[place % across].push(panel);
        }
        columns.into_iter().fold(self, |figure, panels| figure.column(1.0, panels))
    }

    /// The figure with a scene to scale, and what happens in it over time in charts beside it, from the top down.
    #[must_use]
    pub fn scene_with_charts<const N: usize>(self, scene: PlotScene, charts: [Chart; N]) -> Self {
        self.column(SCENE_SHARE, vec![scene.into()]).column(1.0, charts.map(Into::into).into())
    }

    /// Draws the figure, panels and titles.
    #[must_use]
    pub fn to_page(&self) -> Page {
        let [width, height] = self.size;
        let mut page = Page::new(width, height, self.title.clone());
        let body = self.draw_titles(&mut page);
        let shares: f64 = self.columns.iter().map(|column| column.share).sum();
        let mut left = body.left;
        for column in &self.columns {
            let width = body.width * column.share / shares;
            column.draw(&mut page, Area { left, width, ..body });
            left += width;
        }
        page
    }

    /// Draws title and subtitles, and gives the area that is left.
    fn draw_titles(&self, page: &mut Page) -> Area {
        let body = page.area().inside(Margins { left: EDGE, top: EDGE, right: EDGE, bottom: EDGE });
        if self.title.is_empty() {
            return body;
        }
        let mut at = PagePoint::new(body.left + EDGE, body.top + 0.5 * HEADLINE_HEIGHT);
        page.text(Text::new(self.title.clone(), at, HEADLINE_SIZE, Colour::BLACK));
        at = at.moved(0.0, 0.5 * (HEADLINE_HEIGHT + SUBTITLE_HEIGHT) - 4.0);
        let mut top = HEADLINE_HEIGHT;
        for subtitle in &self.subtitles {
            page.text(Text::new(subtitle.clone(), at, SUBTITLE_SIZE, Colour::DARK_GREY));
            at = at.moved(0.0, SUBTITLE_HEIGHT);
            top += SUBTITLE_HEIGHT;
        }
        body.inside(Margins { top, ..Margins::default() })
    }
}

/// Where a row has no more panels.
struct Blank;

impl Panel for Blank {
    fn draw(&self, _page: &mut Page, _panel: Area) {}
}

impl Column {
    fn draw(&self, page: &mut Page, area: Area) {
        let count = u32::try_from(self.panels.len()).unwrap_or(u32::MAX);
        let height = area.height / f64::from(count.max(1));
        for (row, panel) in (0_u32..).zip(&self.panels) {
            panel.draw(page, Area { top: area.top + f64::from(row) * height, height, ..area });
        }
    }
}

impl From<PlotScene> for Box<dyn Panel> {
    fn from(scene: PlotScene) -> Self {
        Box::new(scene)
    }
}

impl From<Chart> for Box<dyn Panel> {
    fn from(chart: Chart) -> Self {
        Box::new(chart)
    }
}
