//! The cover of all poses by boxes, and what is done with each.
//!
//! A box is a rectangle of places of the anchor in the part, along an edge where the anchor is a touch, times an
//! interval of turns. Over it
//!
//! 1. every touch is at least its distance in the middle, less what the box spans, away from the outline: where the sum
//!    of the squares exceeds the gate the box is dropped;
//! 2. few pieces of the outline can be the nearest to each touch. For every choice of them, Newton's step n from the
//!    middle c and a bound e of what is beyond the parabola leave critical points only in c + n ± e. The choice is out
//!    where that misses the box, and has one at most where e is a quarter of the box;
//! 3. else the box is halved. Boxes that are small against the standard deviations end in a descent.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::chain::{Piece, Place};
use super::objective::{Hold, Objective, Support, Vector3Scale, outermost};
use super::settle::{Found, flush_of};
use super::terms::{At, Felt, LineKind, Rest, Share, Span};

/// Touches looked at before all others: far apart, they exclude most boxes.
const SCOUTS_MAX: usize = 8;

/// Choices of pieces looked at for one box; more are told apart by halving it.
const CHOICES_MAX: usize = 24;

/// Where there are too many choices and more than one in so many touches is open, the box is halved at once.
const OPEN_SHARE: usize = 4;

/// Turns beyond which no parabola is worth a try, rad.
const TURN_MAX: f64 = 0.2;

/// One critical point at most where what is beyond the parabola moves it by no more than this share of the box: such a
/// bound grows with the square of the box, so Newton's map contracts by twice this.
const CONTRACTS: f64 = 0.25;

/// A box with a diagonal of fewer standard deviations is so small that a descent from its middle finds what is in it: no
/// two minima in it count as two. From farther away a descent can miss the basin of a shallow one.
const TINY_SD: f64 = super::settle::SAME_SD;

/// Where pieces leave the part free along some direction, boxes are halved down to this share of its size.
const LOOSE_MIN: f64 = 0.02;

/// Directions with less than this of the curvature of the others are free, to rounding.
const FREE: f64 = 1e-9;

/// Rooms of the cover end this far outside the gate.
const ROOM: f64 = 1.0 + 1e-9;

/// Where nothing bounds how far away the part is, it is looked for within so many of its sizes.
const FAR: f64 = 1000.0;

/// A box of poses.
#[derive(Clone, Copy, Debug)]
struct Patch {
    middle: Vector2<f64>,
    /// Unit vector along the first half.
    axis: Vector2<f64>,
    half: [f64; 2],
    theta: f64,
    turn: f64,
}

/// What is known of the critical points of one choice in a box.
enum Verdict {
    None,
    One(At),
    /// One for each value of a direction in which the pieces leave the part free.
    Free(At),
    Unknown,
}

/// What becomes of a box.
enum Next {
    Drop,
    Halve(Axis),
}

#[derive(Clone, Copy, PartialEq)]
enum Axis {
    First,
    Second,
    Turn,
}

/// All local minima of χ² inside the gate, until the search is told to halt.
pub(super) fn minima(objective: &Objective<'_>, gate: f64) -> Found {
    let mut cover = Cover::new(objective, gate);
    let mut found = Found::default();
    let mut patches = cover.rooms();
    let mut looks = objective.halt().now_and_then();
    while let Some(patch) = patches.pop() {
        if looks.goes_on().is_none() {
            break;
        }
        match cover.look(&patch, &mut found) {
            None => break,
            Some(Next::Drop) => {}
            Some(Next::Halve(axis)) => patches.extend(patch.halves(axis)),
        }
    }
    found
}

impl Patch {
    fn halves(&self, axis: Axis) -> [Self; 2] {
        let across = Vector2::new(-self.axis.y, self.axis.x);
        [-0.5, 0.5].map(|share| {
            let mut half = *self;
            match axis {
                Axis::First => {
                    half.half[0] = self.half[0] / 2.0;
                    half.middle += self.axis * (share * self.half[0]);
                }
                Axis::Second => {
                    half.half[1] = self.half[1] / 2.0;
                    half.middle += across * (share * self.half[1]);
                }
                Axis::Turn => {
                    half.turn = self.turn / 2.0;
                    half.theta += share * self.turn;
                }
            }
            half
        })
    }

    fn reach(&self) -> f64 {
        self.half[0].hypot(self.half[1])
    }

    /// A vector of place and turn along the box.
    fn along(&self, v: Vector3<f64>) -> Vector3<f64> {
        Vector3::new(self.axis.dot(&v.xy()), self.axis.perp(&v.xy()), v.z)
    }

    fn halfs(&self) -> Vector3<f64> {
        Vector3::new(self.half[0], self.half[1], self.turn)
    }
}

/// One way to hold a term in a box.
#[derive(Clone, Copy)]
struct Held<H> {
    hold: H,
    share: Share,
    lower: f64,
}

struct Cover<'a, 'b> {
    objective: &'a Objective<'b>,
    gate: f64,
    scouts: Vec<usize>,
    /// The largest distance of what is felt from the anchor, m.
    lever: f64,
    /// Room for the pieces of all touches in a box: by touch where they begin.
    pieces: Vec<(Piece, f64)>,
    begins: Vec<usize>,
    misses: Vec<f64>,
}

impl<'a, 'b> Cover<'a, 'b> {
    fn new(objective: &'a Objective<'b>, gate: f64) -> Self {
        let levers = objective.touches.iter().map(|felt| felt.lever);
        let lever = levers.fold(0.0, f64::max).max(objective.chain.size / 2.0);
        let (pieces, begins, misses) = (Vec::new(), Vec::new(), Vec::new());
        Self { objective, gate, scouts: scouts(&objective.touches), lever, pieces, begins, misses }
    }

    /// Boxes that hold every pose inside the gate.
    fn rooms(&self) -> Vec<Patch> {
        let whole = |middle, half| Patch {
            middle,
            axis: Vector2::x(),
            half: [half; 2],
            theta: 0.0,
            turn: std::f64::consts::PI * ROOM,
        };
        let size = self.objective.chain.size;
        let centre = self.objective.convex.centre().coords;
        let Some(anchored) = self.objective.anchored else { return vec![whole(centre, self.far() * ROOM)] };
        let width = ROOM * self.gate.sqrt() / self.objective.touches[anchored].weight;
        if width > size / 8.0 {
            return vec![whole(centre, self.objective.convex.reach() + width)];
        }
        let along = |edge: &super::chain::Edge| Patch {
            middle: edge.start + edge.along * (edge.length / 2.0),
            axis: edge.along,
            half: [edge.length / 2.0 + width, width],
            ..whole(Vector2::zeros(), 0.0)
        };
        self.objective.chain.edges.iter().map(along).collect()
    }

    /// How far the part can be from the anchor where that is no touch, m.
    fn far(&self) -> f64 {
        let (convex, root) = (&self.objective.convex, self.gate.sqrt());
        let across = 2.0 * convex.reach();
        let lines = &self.objective.lines;
        let mut least = FAR * across;
        for pair in lines.windows(2) {
            if let [LineKind::Bearing { anchor, angle: right, .. }, LineKind::Bearing { angle: left, .. }] =
                [pair[0].kind, pair[1].kind]
            {
                let opening = (left - right).rem_euclid(std::f64::consts::TAU) - 2.0 * root / pair[0].weight;
                if opening > 0.0 && anchor == Vector2::zeros() {
                    // So far away the whole part is seen under a smaller angle.
                    least = least.min(across / 2.0 + across / (2.0 * (opening / 2.0).min(1.5).sin()));
                }
            }
        }
        let fence = |line: &super::terms::Line| match line.kind {
            LineKind::Fence { normal, beyond } => Some((normal, beyond, root / line.weight)),
            LineKind::Bearing { .. } => None,
        };
        let fences: Vec<_> = lines.iter().filter_map(fence).collect();
        for (k, (a, beyond_a, width_a)) in fences.iter().enumerate() {
            for (b, beyond_b, width_b) in &fences[..k] {
                let sine = a.perp(b).abs();
                if sine > 0.0 {
                    let off = beyond_a.abs() + beyond_b.abs() + width_a + width_b + across;
                    least = least.min(off / sine);
                }
            }
        }
        least
    }

    /// What becomes of a box; none where the search should halt.
    fn look(&mut self, patch: &Patch, found: &mut Found) -> Option<Next> {
        let at = At::new(patch.middle, patch.theta);
        let span = Span { reach: patch.reach(), turn: patch.turn };
        let mut lower = 0.0;
        for &scout in &self.scouts {
            lower += self.least(&self.objective.touches[scout], &at, &span);
            if lower > self.gate {
                return Some(Next::Drop);
            }
        }
        let lines = self.least_of_lines(&at, &span, self.gate - lower);
        if lower + lines > self.gate {
            return Some(Next::Drop);
        }
        let widest = self.widest(patch);
        if patch.turn > TURN_MAX {
            return Some(Next::Halve(widest));
        }
        self.pieces.clear();
        self.begins.clear();
        let mut lower = lines;
        for index in 0..self.objective.touches.len() {
            self.objective.goes_on_at(index)?;
            self.begins.push(self.pieces.len());
            lower += self.pieces_of(index, &at, &span);
            if lower > self.gate {
                return Some(Next::Drop);
            }
        }
        self.begins.push(self.pieces.len());
        self.judge(patch, &at, lower, found)
    }

    /// The widest side of a box, turns by how far they move things.
    fn widest(&self, patch: &Patch) -> Axis {
        let turned = self.lever * patch.turn;
        if turned >= patch.half[0] && turned >= patch.half[1] {
            Axis::Turn
        } else if patch.half[0] >= patch.half[1] {
            Axis::First
        } else {
            Axis::Second
        }
    }

    /// What a touch adds to χ² at least.
    #[inline]
    fn least(&self, felt: &Felt, at: &At, span: &Span) -> f64 {
        let chain = &self.objective.chain;
        let point = felt.on_part(at);
        let room = span.reach + felt.lever * span.turn;
        let Some((angle, normal_weight)) = felt.normal else {
            let squared = chain.edges.iter().map(|edge| edge.distance_squared(point)).fold(f64::INFINITY, f64::min);
            return ((squared.sqrt() - room).max(0.0) * felt.weight).powi(2);
        };
        let apart = |squared: f64| ((squared.sqrt() - room).max(0.0) * felt.weight).powi(2);
        let mut least = f64::INFINITY;
        for (index, edge) in chain.edges.iter().enumerate() {
            let miss = felt.normal_miss(edge.angle, at.theta).abs() - span.turn * normal_weight;
            least = least.min(miss.max(0.0).powi(2) + apart(edge.distance_squared(point)));
            let corner = &chain.corners[index];
            if corner.is_convex() {
                let miss = (corner.beyond(angle - at.theta) - span.turn).max(0.0) * normal_weight;
                least = least.min(miss * miss + apart((point - corner.at).norm_squared()));
            }
        }
        least
    }

    /// What lines add to χ² in a box at least; no more of them are looked at than are enough to exceed a bound.
    fn least_of_lines(&mut self, at: &At, span: &Span, enough: f64) -> f64 {
        let objective = self.objective;
        let mut least = 0.0;
        for line in &objective.lines {
            line.misses(&objective.hull, at, &mut self.misses);
            let miss = self.misses[outermost(&self.misses, line.sense())];
            let room = self.room_of_line(line, at, span);
            least += (miss.abs() - room).max(0.0).powi(2);
            if least > enough {
                break;
            }
        }
        least
    }

    /// By how much a line's miss can change in a box, in standard deviations.
    fn room_of_line(&self, line: &super::terms::Line, at: &At, span: &Span) -> f64 {
        let convex = &self.objective.convex;
        let lever = (convex.centre().coords - at.place).norm() + convex.reach();
        let moved = span.reach + lever * span.turn;
        match line.kind {
            LineKind::Fence { .. } => moved * line.weight,
            LineKind::Bearing { anchor, .. } => {
                let sensor = at.place - at.in_part(anchor);
                let away = -convex.depth(nalgebra::Point2::from(sensor));
                if away <= moved { f64::INFINITY } else { (moved / away).asin() * line.weight }
            }
        }
    }

    /// Lists the pieces that can hold a touch in a box, nearest first, and says what it adds to χ² at least.
    fn pieces_of(&mut self, index: usize, at: &At, span: &Span) -> f64 {
        let felt = &self.objective.touches[index];
        let chain = &self.objective.chain;
        let begin = self.pieces.len();
        let point = felt.on_part(at);
        let room = span.reach + felt.lever * span.turn;
        let low = |distance: f64| ((distance - room).max(0.0) * felt.weight).powi(2);
        let high = |distance: f64| ((distance + room) * felt.weight).powi(2);
        let mut highest = f64::INFINITY;
        for (k, edge) in chain.edges.iter().enumerate() {
            let (along, off) = edge.along_and_off(point);
            let beyond = along - along.clamp(0.0, edge.length);
            let distance = (off * off + beyond * beyond).sqrt();
            let corner = &chain.corners[k];
            let before = chain.before(k);
            let can_begin = along <= room;
            let can_end = chain.edges[before].along_and_off(point).0 >= chain.edges[before].length - room;
            let to_corner =
                if can_begin || can_end || felt.normal.is_some() { (point - corner.at).norm() } else { f64::INFINITY };
            let can_hold = -room <= along && along <= edge.length + room;
            let Some((angle, weight)) = felt.normal else {
                highest = highest.min(high(distance));
                if can_hold {
                    self.pieces.push((Piece { place: Place::Edge(k), normal: None }, low(off.abs())));
                }
                if can_begin && can_end {
                    self.pieces.push((Piece { place: Place::Corner(k), normal: None }, low(to_corner)));
                }
                continue;
            };
            let turned = span.turn * weight;
            let miss = felt.normal_miss(edge.angle, at.theta).abs();
            let (low_miss, high_miss) = ((miss - turned).max(0.0).powi(2), (miss + turned).powi(2));
            highest = highest.min(high(distance) + high_miss);
            if can_hold {
                self.pieces.push((Piece { place: Place::Edge(k), normal: Some(k) }, low(off.abs()) + low_miss));
            }
            if can_begin {
                self.pieces.push((Piece { place: Place::Corner(k), normal: Some(k) }, low(to_corner) + low_miss));
            }
            if can_end {
                let miss = felt.normal_miss(chain.edges[before].angle, at.theta).abs();
                let low_miss = (miss - turned).max(0.0).powi(2);
                self.pieces.push((Piece { place: Place::Corner(k), normal: Some(before) }, low(to_corner) + low_miss));
            }
            if corner.is_convex() {
                let beyond = corner.beyond(angle - at.theta);
                if beyond <= span.turn {
                    self.pieces.push((Piece { place: Place::Corner(k), normal: None }, low(to_corner)));
                }
                highest = highest.min(high(to_corner) + ((beyond + span.turn) * weight).powi(2));
            }
        }
        // None of those can be the nearest that are farther everywhere than another is anywhere.
        let mut kept = begin;
        for k in begin..self.pieces.len() {
            if self.pieces[k].1 <= highest {
                self.pieces.swap(kept, k);
                kept += 1;
            }
        }
        self.pieces.truncate(kept);
        self.pieces[begin..].sort_by(|a, b| a.1.total_cmp(&b.1));
        self.pieces.get(begin).map_or(f64::INFINITY, |piece| piece.1)
    }

    /// Judges all choices of pieces for a box.
    fn judge(&mut self, patch: &Patch, at: &At, lower: f64, found: &mut Found) -> Option<Next> {
        let objective = self.objective;
        let spans = self.spans(patch);
        let mut base = Share::zero();
        let mut hold = Hold::default();
        // Terms that more than one piece can hold: which, and by what.
        let mut open: Vec<(usize, Vec<Held<Piece>>)> = Vec::new();
        for (index, felt) in objective.touches.iter().enumerate() {
            objective.goes_on_at(index)?;
            let pieces = &self.pieces[self.begins[index]..self.begins[index + 1]];
            let least = pieces.first()?.1;
            let fits = |piece: &&(Piece, f64)| piece.1 - least + lower <= self.gate;
            let option = |(piece, low): &(Piece, f64)| Held {
                hold: *piece,
                share: felt.share(&objective.chain, *piece, at, &spans),
                lower: low - least,
            };
            hold.touches.push(pieces.first()?.0);
            let mut options = pieces.iter().filter(fits).map(option);
            let first = options.next()?;
            match options.next() {
                None => base.add(&first.share),
                Some(second) => open.push((index, [first, second].into_iter().chain(options).collect())),
            }
        }
        let mut open_lines: Vec<(usize, Vec<Held<Support>>)> = Vec::new();
        for line in 0..objective.lines.len() {
            let options = self.supports(line, at, &spans);
            hold.lines.push(options.first()?.hold);
            if options.len() == 1 {
                base.add(&options[0].share);
            } else {
                open_lines.push((line, options));
            }
        }
        let near = open.iter().map(|(_, options)| &options[0].share);
        let near_lines = open_lines.iter().map(|(_, options)| &options[0].share);
        let mut middle = base;
        near.chain(near_lines).for_each(|share| middle.add(share));
        if self.is_tiny(patch, &middle.gauss) {
            objective.settle(at, self.gate, found)?;
            return Some(Next::Drop);
        }
        // Of many lines there are more choices than numbers.
        let line_choices = open_lines.iter().try_fold(1, |all: usize, (_, options)| all.checked_mul(options.len()));
        let Some(line_choices) = line_choices.filter(|choices| *choices <= CHOICES_MAX) else {
            return Some(Next::Halve(self.widest(patch)));
        };
        let all = open.iter().try_fold(line_choices, |all: usize, (_, options)| all.checked_mul(options.len()));
        let is_few = all.is_some_and(|all| all <= CHOICES_MAX);
        if !is_few && open.len() * OPEN_SHARE > objective.touches.len() {
            return Some(Next::Halve(self.widest(patch)));
        }
        // The touches that matter most are told apart; what the others may do is part of the bounds.
        let blurs = open.iter().map(|(_, options)| if is_few { Blur::NONE } else { Blur::of(options, &spans) });
        let mut order: Vec<_> = open.iter().zip(blurs).collect();
        order.sort_by(|a, b| b.1.0[0].place.total_cmp(&a.1.0[0].place));
        let mut choices = line_choices;
        let mut told_apart = Vec::with_capacity(order.len());
        let mut blurred = false;
        for ((index, options), blur) in order {
            if choices * options.len() <= CHOICES_MAX {
                choices *= options.len();
                told_apart.push((*index, options));
            } else {
                blurred = true;
                base.add(&options[0].share);
                for (rest, more) in base.rest.iter_mut().zip(&blur.0) {
                    rest.place += more.place;
                    rest.turn += more.turn;
                }
            }
        }
        let mut starts = Vec::new();
        for choice in 0..choices {
            let (mut sum, mut low, mut rest) = (base, lower, choice);
            for (index, options) in &told_apart {
                let option = &options[rest % options.len()];
                rest /= options.len();
                sum.add(&option.share);
                low += option.lower;
                hold.touches[*index] = option.hold;
            }
            for (line, options) in &open_lines {
                let option = &options[rest % options.len()];
                rest /= options.len();
                sum.add(&option.share);
                hold.lines[*line] = option.hold;
            }
            if low > self.gate {
                continue;
            }
            let is_flush = hold.lines.iter().any(|support| matches!(support, Support::Flush(_)));
            let verdict = if is_flush {
                self.verdict_flush(patch, at, &sum, &hold, &spans)
            } else {
                self.verdict(patch, at, &sum)
            };
            match verdict {
                Verdict::None => {}
                Verdict::One(start) if !blurred => starts.push((start, hold.clone())),
                Verdict::Free(start) if !blurred => {
                    if found.loose.is_some()
                        || patch.reach().max(self.lever * patch.turn) < LOOSE_MIN * objective.chain.size
                    {
                        starts.push((start, hold.clone()));
                    } else {
                        let holds =
                            objective.refined(&hold, &start).map(|end| objective.accept(&end, &hold, self.gate, found));
                        if holds.flatten() != Some(true) {
                            return Some(Next::Halve(self.widest(patch)));
                        }
                    }
                }
                // What is beyond the parabola grows with the turn above all.
                _ if self.lever * patch.turn * 4.0 >= patch.half[0].max(patch.half[1]) => {
                    return Some(Next::Halve(if blurred { self.widest(patch) } else { Axis::Turn }));
                }
                _ => return Some(Next::Halve(self.widest(patch))),
            }
        }
        for (start, hold) in starts {
            if flush_of(&hold).is_empty() {
                if let Some(end) = objective.refined(&hold, &start) {
                    objective.accept(&end, &hold, self.gate, found)?;
                }
            } else {
                objective.accept_flush(&hold, &start, self.gate, found)?;
            }
        }
        objective.halt().goes_on()?;
        Some(Next::Drop)
    }

    /// What bounds are wanted over: the box, and one about it that is as long as wide. No thinner box can have a
    /// parabola that is surer of itself.
    fn spans(&self, patch: &Patch) -> [Span; 2] {
        let halfs = self.wide(patch);
        [Span { reach: patch.reach(), turn: patch.turn }, Span { reach: halfs.x.hypot(halfs.y), turn: halfs.z }]
    }

    fn wide(&self, patch: &Patch) -> Vector3<f64> {
        let least = patch.half[0].max(patch.half[1]).max(self.lever * patch.turn) / 2.0;
        Vector3::new(patch.half[0].max(least), patch.half[1].max(least), patch.turn.max(least / self.lever))
    }

    fn is_tiny(&self, patch: &Patch, gauss: &Matrix3<f64>) -> bool {
        let across = Vector2::new(-patch.axis.y, patch.axis.x);
        let place = gauss.fixed_view::<2, 2>(0, 0);
        let along = |axis: Vector2<f64>| axis.dot(&(place * axis)).max(0.0).sqrt();
        let sd = patch.half[0] * along(patch.axis) + patch.half[1] * along(across) + patch.turn * gauss[(2, 2)].sqrt();
        sd < TINY_SD
    }

    /// Where the critical points of a choice can be in a box.
    fn verdict(&self, patch: &Patch, at: &At, sum: &Share) -> Verdict {
        let curvature = sum.gauss + sum.bend;
        let scaled = Vector3Scale::of(&sum.gauss).map(|scale| scale.scaled(&curvature));
        let is_free = scaled.is_none_or(|scaled| scaled.determinant().abs() < FREE)
            && sum.directions.symmetric_eigenvalues().min() < FREE * FREE.sqrt();
        if is_free {
            return self.verdict_free(patch, at, sum);
        }
        let Some(inverse) = curvature.try_inverse() else { return Verdict::Unknown };
        let step = -(inverse * sum.gradient);
        let error = |rest: &Rest| {
            let row = |k: usize| {
                let row = match k {
                    0 => inverse.transpose() * Vector3::new(patch.axis.x, patch.axis.y, 0.0),
                    1 => inverse.transpose() * Vector3::new(-patch.axis.y, patch.axis.x, 0.0),
                    _ => inverse.row(2).transpose(),
                };
                row.xy().norm() * rest.place + row.z.abs() * rest.turn
            };
            Vector3::new(row(0), row(1), row(2))
        };
        let (along, halfs) = (patch.along(step), patch.halfs());
        let near = error(&sum.rest[0]);
        if (0..3).any(|k| along[k].abs() > ROOM * halfs[k] + near[k]) {
            return Verdict::None;
        }
        let (wide, far) = (self.wide(patch), error(&sum.rest[1]));
        if (0..3).all(|k| far[k] <= CONTRACTS * wide[k]) {
            Verdict::One(at.stepped(&step))
        } else if self.step_along_axes(patch, sum).is_none() {
            Verdict::None
        } else {
            Verdict::Unknown
        }
    }

    /// The same where the pieces leave the part free along some direction.
    fn verdict_free(&self, patch: &Patch, at: &At, sum: &Share) -> Verdict {
        self.step_along_axes(patch, sum).map_or(Verdict::None, |step| Verdict::Free(at.stepped(&step)))
    }

    /// Newton's step, taken along each axis of the curvature by itself, but those that are free; none where one of them
    /// leads out of the box for certain. That says more than a step along the box's own sides where the curvature is far
    /// larger along some axes than along others.
    fn step_along_axes(&self, patch: &Patch, sum: &Share) -> Option<Vector3<f64>> {
        let floor = sum.gauss[(0, 0)].max(sum.gauss[(1, 1)]).max(f64::MIN_POSITIVE);
        let size = self.objective.chain.size;
        let scale = Vector3Scale(Vector3::new(floor.sqrt(), floor.sqrt(), floor.sqrt() * size));
        let axes = scale.scaled(&(sum.gauss + sum.bend)).symmetric_eigen();
        let gradient = sum.gradient.component_div(&scale.0);
        let halfs = patch.halfs();
        let mut step = Vector3::zeros();
        for (value, axis) in axes.eigenvalues.iter().zip(axes.eigenvectors.column_iter()) {
            if value.abs() < FREE {
                continue;
            }
            let moved = -axis.dot(&gradient) / value;
            let extent = patch.along(axis.component_mul(&scale.0)).abs().dot(&halfs);
            let rests = axis.component_div(&scale.0);
            let error = (rests.xy().norm() * sum.rest[0].place + rests.z.abs() * sum.rest[0].turn) / value.abs();
            if moved.abs() > ROOM * extent + error {
                return None;
            }
            step += axis * moved;
        }
        Some(step.component_div(&scale.0))
    }

    /// The same where sides are flush on some lines.
    fn verdict_flush(&self, patch: &Patch, at: &At, sum: &Share, hold: &Hold, spans: &[Span; 2]) -> Verdict {
        let flush = flush_of(hold);
        let count = 3 + flush.len();
        let mut matrix = nalgebra::DMatrix::zeros(count, count);
        let mut right = nalgebra::DVector::zeros(count);
        let mut rests = sum.rest;
        let mut ties = vec![[0.0; 2]; flush.len()];
        let mut curvature = sum.gauss + sum.bend;
        for (k, (line, side)) in flush.iter().enumerate() {
            let (first, first_changes) = self.objective.line_row(*line, *side, at, spans);
            let (second, second_changes) = self.objective.line_row(*line, self.objective.next(*side), at, spans);
            let weight = self.objective.lines[*line].weight;
            let slope = first.slope - second.slope;
            curvature -= (first.bend - second.bend) * (first.value / 2.0);
            for axis in 0..3 {
                matrix[(3 + k, axis)] = slope[axis];
                matrix[(axis, 3 + k)] = slope[axis];
            }
            right[3 + k] = second.value - first.value;
            for (which, (a, b)) in first_changes.iter().zip(&second_changes).enumerate() {
                ties[k][which] = weight * (a.value_rest + b.value_rest);
                let pull = (first.value.abs() / 2.0 + weight * a.value) * weight;
                rests[which].place += pull * (a.bent[0] + b.bent[0] + a.bent_rest[0] + b.bent_rest[0]);
                rests[which].turn += pull * (a.bent[1] + b.bent[1] + a.bent_rest[1] + b.bent_rest[1]);
            }
        }
        matrix.view_mut((0, 0), (3, 3)).copy_from(&curvature);
        right.rows_mut(0, 3).copy_from(&-sum.gradient);
        let Some(inverse) = matrix.try_inverse() else { return Verdict::Unknown };
        let solution = &inverse * right;
        let step = Vector3::new(solution[0], solution[1], solution[2]);
        let error = |which: usize| {
            let row = |weights: Vector3<f64>| {
                let row = inverse.rows(0, 3).transpose() * weights;
                let places = row[0].hypot(row[1]) * rests[which].place + row[2].abs() * rests[which].turn;
                places + (0..flush.len()).map(|k| row[3 + k].abs() * ties[k][which]).sum::<f64>()
            };
            Vector3::new(
                row(Vector3::new(patch.axis.x, patch.axis.y, 0.0)),
                row(Vector3::new(-patch.axis.y, patch.axis.x, 0.0)),
                row(Vector3::z()),
            )
        };
        let (along, halfs, near) = (patch.along(step), patch.halfs(), error(0));
        if (0..3).any(|k| along[k].abs() > ROOM * halfs[k] + near[k]) {
            return Verdict::None;
        }
        let (wide, far) = (self.wide(patch), error(1));
        if (0..3).all(|k| far[k] <= CONTRACTS * wide[k]) { Verdict::One(at.stepped(&step)) } else { Verdict::Unknown }
    }

    /// What a line can be touched with in a box, outermost first.
    fn supports(&mut self, line: usize, at: &At, spans: &[Span; 2]) -> Vec<Held<Support>> {
        let objective = self.objective;
        let the_line = &objective.lines[line];
        the_line.misses(&objective.hull, at, &mut self.misses);
        let sense = the_line.sense();
        let first = outermost(&self.misses, sense);
        let span = &spans[0];
        // Between two corners only their own distance counts on a fence; on a bearing each moves.
        let room = |corner: usize| match the_line.kind {
            LineKind::Fence { .. } => {
                (objective.hull[corner] - objective.hull[first]).norm() * span.turn * the_line.weight
            }
            LineKind::Bearing { anchor, .. } => {
                let alone = |corner: usize| {
                    let away = (at.in_part(anchor) + objective.hull[corner] - at.place).norm();
                    let moved = span.reach + (objective.hull[corner] - at.place).norm() * span.turn;
                    if away <= moved { f64::INFINITY } else { (moved / away).asin() * the_line.weight }
                };
                alone(corner) + alone(first)
            }
        };
        let rounding = 1e-9;
        let can = |corner: usize| {
            corner == first || sense * (self.misses[first] - self.misses[corner]) <= room(corner) + rounding
        };
        let count = self.misses.len();
        let mut corners: Vec<usize> = (0..count).filter(|corner| can(*corner)).collect();
        corners.sort_by(|a, b| (sense * self.misses[*b]).total_cmp(&(sense * self.misses[*a])));
        let option = |hold: Support| {
            let (Support::Corner(corner) | Support::Flush(corner)) = hold;
            Held { hold, share: objective.line_share(line, corner, at, spans), lower: 0.0 }
        };
        let mut options: Vec<_> = corners.iter().map(|corner| option(Support::Corner(*corner))).collect();
        if corners.len() > 1 && sense * self.misses[first] > -self.room_of_line(the_line, at, span) {
            let sides = corners.iter().filter(|corner| can(objective.next(**corner)));
            options.extend(sides.map(|corner| option(Support::Flush(*corner))));
        }
        options
    }
}

/// What it may add beyond the parabola that one of several pieces holds a touch rather than the nearest.
struct Blur([Rest; 2]);

impl Blur {
    const NONE: Self = Self([Rest { place: 0.0, turn: 0.0 }; 2]);

    fn of(options: &[Held<Piece>], spans: &[Span; 2]) -> Self {
        let mut blur = [Rest::default(); 2];
        let near = &options[0].share;
        for option in &options[1..] {
            let apart = option.share.gradient - near.gradient;
            let bent = (option.share.gauss + option.share.bend) - (near.gauss + near.bend);
            for (k, span) in spans.iter().enumerate() {
                let place = bent.fixed_view::<2, 2>(0, 0).norm() * span.reach
                    + bent.fixed_view::<2, 1>(0, 2).norm() * span.turn;
                let turn = bent.fixed_view::<1, 2>(2, 0).norm() * span.reach + bent[(2, 2)].abs() * span.turn;
                let rest = &option.share.rest[k];
                blur[k].place = blur[k].place.max(apart.xy().norm() + place + rest.place);
                blur[k].turn = blur[k].turn.max(apart.z.abs() + turn + rest.turn);
            }
        }
        Self(blur)
    }
}

/// Touches far from each other, the farthest from the anchor first.
fn scouts(touches: &[Felt]) -> Vec<usize> {
    let mut distances: Vec<f64> = touches.iter().map(|felt| felt.lever).collect();
    let mut chosen = Vec::new();
    while chosen.len() < SCOUTS_MAX.min(touches.len()) {
        let far = (0..touches.len()).filter(|k| !chosen.contains(k));
        let Some(next) = far.max_by(|a, b| distances[*a].total_cmp(&distances[*b])) else { break };
        chosen.push(next);
        for (distance, felt) in distances.iter_mut().zip(touches) {
            *distance = distance.min((felt.from_anchor - touches[next].from_anchor).norm());
        }
    }
    chosen
}
