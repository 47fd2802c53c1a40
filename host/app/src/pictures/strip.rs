//! What happened one after the other: a panel for each step, in rows.
//!
//! Pure.

use crate::pictures::plot::{Figure, PlotScene};

/// Steps that are drawn at most: the last ones. More would be too small to be seen.
const STEPS_MAX: usize = 12;

/// Panels beside each other.
const ACROSS: usize = 4;

/// Size of a panel, and height of the page beyond them.
const PANEL: [f64; 2] = [300.0, 330.0];
const HEADLINES: f64 = 90.0;

/// The strip of some steps, each drawn by its number, from 0; `names` is what a step is called, such as `approach`.
pub(super) fn strip(
    title: &str,
    subtitles: &[String],
    [name, names]: [&str; 2],
    count: usize,
    scene: impl Fn(usize) -> PlotScene,
) -> Figure {
    let first = count.saturating_sub(STEPS_MAX);
    let panels: Vec<_> = (first..count).map(|step| scene(step).into()).collect();
    let shown = panels.len().max(1);
    let (across, rows) = (shown.min(ACROSS), shown.div_ceil(ACROSS));
    // Titles need the width of two panels.
    let width = PANEL[0] * across.max(2) as f64;
    let mut figure = Figure::new(title, width, HEADLINES + PANEL[1] * rows as f64).subtitles(subtitles);
    if first > 0 {
        let words = if first == 1 { format!("{name} 1 is") } else { format!("{names} 1 to {first} are") };
        figure = figure.subtitle(format!("{words} not drawn"));
    }
    figure.rows(ACROSS, panels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_steps_are_drawn_and_that_is_said() {
        let drawn = |count| {
            let scene = |step: usize| PlotScene::new(format!("step {}", step + 1));
            strip("a title", &[], ["step", "steps"], count, scene).to_page().to_svg()
        };
        let (few, many) = (drawn(5), drawn(STEPS_MAX + 2));
        assert!(few.contains("\"step 1\"") && few.contains("\"step 5\"") && !few.contains("not drawn"), "{few}");
        assert!(many.contains("steps 1 to 2 are not drawn") && !many.contains("\"step 2\""), "{many}");
        assert!(many.contains("\"step 3\"") && many.contains("\"step 14\""), "{many}");
    }
}
