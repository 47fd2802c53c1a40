//! A grid of cells that finds which segments may meet.

use nalgebra::{Point2, Vector2};

use super::crossings::index;
use crate::geometry::exact::Segment;

/// Cells a segment, about: fewer make longer lists, more take longer to fill.
const CELLS_PER_SEGMENT: f64 = 1.0;

/// Most cells along a side.
const SIDE_MAX: f64 = 1024.0;

/// Widens what a segment covers, in cells, against rounding of cell coordinates.
const SLACK_CELLS: f64 = 1e-6;

/// Segments by the cells they pass.
#[derive(Debug)]
pub(super) struct Grid {
    origin: Point2<f64>,
    cells_per_metre: Vector2<f64>,
    side: usize,
    cells: Vec<Vec<u32>>,
    /// The segment for which each segment was last listed.
    listed_for: Vec<u32>,
    near: Vec<u32>,
}

impl Grid {
    /// An empty grid for these segments.
    pub(super) fn new(segments: impl ExactSizeIterator<Item = Segment>) -> Self {
        let count = segments.len();
        let (mut low, mut high) = (Point2::new(f64::MAX, f64::MAX), Point2::new(f64::MIN, f64::MIN));
        for segment in segments {
            low = low.inf(&segment.start).inf(&segment.end);
            high = high.sup(&segment.start).sup(&segment.end);
        }
        let side = (f64::from(index(count)) * CELLS_PER_SEGMENT).sqrt().clamp(1.0, SIDE_MAX).floor();
        let cells_per_metre = (high - low).map(|extent| if extent > 0.0 { side / extent } else { 0.0 });
        let side = whole(side);
        let cells = vec![Vec::new(); side * side];
        Self { origin: low, cells_per_metre, side, cells, listed_for: vec![u32::MAX; count], near: Vec::new() }
    }

    /// Inserts a segment and lists those inserted before that share a cell with it, each once.
    pub(super) fn insert(&mut self, number: usize, segment: Segment) -> &[u32] {
        let [from, to] = [segment.start, segment.end].map(|p| (p - self.origin).component_mul(&self.cells_per_metre));
        let (from, to) = if from.y <= to.y { (from, to) } else { (to, from) };
        self.near.clear();
        for row in self.cell(from.y - SLACK_CELLS)..=self.cell(to.y + SLACK_CELLS) {
            let (left, right) = span_in_row(from, to, f64::from(index(row)));
            for column in self.cell(left - SLACK_CELLS)..=self.cell(right + SLACK_CELLS) {
                self.visit(row * self.side + column, index(number));
            }
        }
        &self.near
    }

    fn visit(&mut self, cell: usize, number: u32) {
        for &other in &self.cells[cell] {
            if std::mem::replace(&mut self.listed_for[other as usize], number) != number {
                self.near.push(other);
            }
        }
        self.cells[cell].push(number);
    }

    /// The cell that a coordinate falls into, along a side.
    fn cell(&self, coordinate: f64) -> usize {
        whole(coordinate).min(self.side - 1)
    }
}

/// The abscissas that an upward segment covers between the ordinates `row` and `row + 1`.
fn span_in_row(from: Vector2<f64>, to: Vector2<f64>, row: f64) -> (f64, f64) {
    let rise = to.y - from.y;
    if rise < SLACK_CELLS {
        return (from.x.min(to.x), from.x.max(to.x));
    }
    let at = |y: f64| from.x + (to.x - from.x) * ((y.clamp(from.y, to.y) - from.y) / rise);
    let (enters, leaves) = (at(row - SLACK_CELLS), at(row + 1.0 + SLACK_CELLS));
    (enters.min(leaves), enters.max(leaves))
}

/// The whole part; 0 for what is negative.
fn whole(value: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates, which is what is wanted")]
    let whole = value as usize;
    whole
}
