//! Where to put the points: regions of the subdivision that tell polygons apart, and the middle of each (thesis ch. 3).

use nalgebra::Point2;

use super::circle::{Circle, largest_circle};
use super::discriminate::{Choice, Effort, Proof, Search, SetSystem, halting_fewest};
use super::subdivision::Subdivision;
use crate::geometry::exact::turn;
use crate::geometry::{SimplePolygon, distance_to_segment};
use crate::math::bits::BitSet;
use crate::search::{Halt, Stop, never};

/// Points with more room than this share of the scene's extent are inside their region whatever rounding did; with
/// less, that is decided exactly.
const SURELY_INSIDE: f64 = 1e-9;

/// What is asked of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Regions of this area or less are left out, m².
    pub min_area: f64,
    /// Points nearer than this to an edge are left out, m.
    pub min_clearance: f64,
    /// By how many points any two polygons must differ: see [`Search::separation`]. Two that cannot differ by so many
    /// differ by all the points that there are for them.
    pub separation: usize,
    /// Whether the points shall be fewest, or be chosen at once.
    pub objective: Objective,
}

/// What is wanted of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objective {
    /// The fewest points; of all such plans the one with the largest smallest clearance.
    Fewest,
    /// What the greedy choice gives: at most 2 ln n times as many as needed, at once.
    Greedy,
}

impl Default for Request {
    fn default() -> Self {
        Self { min_area: 0.0, min_clearance: 0.0, separation: 1, objective: Objective::Fewest }
    }
}

/// Points that tell polygons apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The points; their radii are their clearances: the distance to the nearest edge of any polygon.
    pub points: Vec<Circle>,
    /// For each polygon, which of the points are in it.
    pub signatures: Vec<Vec<bool>>,
    /// Bounded faces inside at least one polygon, of more than the least area.
    pub regions: usize,
    /// No plan has fewer points.
    pub lower_bound: usize,
    /// What proves `lower_bound`.
    pub proof: Proof,
    /// No plan of so many points has a larger smallest clearance, m; none where nothing is proven about it.
    pub clearance_bound: Option<f64>,
    /// Pairs of polygons that no points tell apart as often as was asked, the lesser number first.
    pub indistinguishable: Vec<[usize; 2]>,
}

impl Plan {
    /// The smallest clearance, m; infinite for no points.
    #[must_use]
    pub fn clearance(&self) -> f64 {
        self.points.iter().map(|point| point.radius).fold(f64::INFINITY, f64::min)
    }

    /// Whether no plan has fewer points.
    #[must_use]
    pub fn is_fewest(&self) -> bool {
        self.lower_bound >= self.points.len()
    }
}

/// Points that tell polygons apart. `stop` ends the search for fewer points; the regions are found in any case, which
/// [`Scene::new_until`] lets end too.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::SimplePolygon;
/// use palpate::point_sampling::{Request, plan};
///
/// // A block in three places.
/// let block = |x: f64| SimplePolygon::new([[x, 0.0], [x + 0.06, 0.0], [x + 0.06, 0.04], [x, 0.04]].map(Point2::from));
/// let plan = plan(&[block(0.0)?, block(0.02)?, block(0.04)?], &Request::default(), &|| false);
/// assert_eq!((plan.points.len(), plan.lower_bound), (2, 2));
/// assert!((plan.clearance() - 0.01).abs() < 1e-12); // m
/// # Ok::<(), palpate::geometry::PolygonError>(())
/// ```
#[must_use]
pub fn plan(polygons: &[SimplePolygon], request: &Request, stop: Stop<'_>) -> Plan {
    // The stop ends the search for fewer points, whatever it says at first: without the regions there is no plan.
    Scene::new(polygons).plan(request, stop)
}

/// Polygons with the places where points can be.
#[derive(Debug)]
pub struct Scene {
    polygons: Vec<SimplePolygon>,
    candidates: Vec<Candidate>,
    areas: Vec<f64>,
}

/// A place for a point, in the middle of a region.
#[derive(Clone, Debug)]
struct Candidate {
    circle: Circle,
    area: f64,
    inside: BitSet,
}

impl Scene {
    /// Finds the regions and the middle of each.
    #[must_use]
    pub fn new(polygons: &[SimplePolygon]) -> Self {
        Self::new_until(polygons, &never).unwrap_or_else(|| unreachable!("nobody wishes it to stop"))
    }

    /// The same, ended when `stop` says so: then there is none, because without all regions no plan is sound.
    #[must_use]
    pub fn new_until(polygons: &[SimplePolygon], stop: Stop<'_>) -> Option<Self> {
        let subdivision = Subdivision::new_until(polygons, stop)?;
        let (mut candidates, mut areas) = (Vec::new(), Vec::new());
        let trusted = SURELY_INSIDE * extent(polygons);
        for region in subdivision.regions() {
            if stop.stops() {
                return None;
            }
            let area = region.area();
            areas.push(area);
            let Some(circle) = largest_circle(region.boundary()) else { continue };
            let inside = region.inside();
            // The middle of a sliver may round into its neighbour; then no point is in it at all.
            let fits = |(number, polygon): (usize, &SimplePolygon)| {
                contains(polygon, circle.centre) == Some(inside.has(number))
            };
            if circle.radius > trusted || polygons.iter().enumerate().all(fits) {
                candidates.push(Candidate { circle, area, inside: inside.to_set() });
            }
        }
        // The roomiest first: of regions that say the same, the first is taken.
        let candidates = roomiest_first(candidates, &Halt::new(stop))?;
        Some(Self { polygons: polygons.to_vec(), candidates, areas })
    }

    /// Plans points as the request asks, or as good as was found when it is stopped.
    #[must_use]
    pub fn plan(&self, request: &Request, stop: Stop<'_>) -> Plan {
        let (_, chosen) = self.chosen(request, stop, &Halt::new(&never)).unwrap_or_else(nobody_halts);
        self.plan_of(chosen, request)
    }

    /// The same, but none where `stop` says so before there is any plan.
    #[must_use]
    pub fn plan_until(&self, request: &Request, stop: Stop<'_>) -> Option<Plan> {
        let halt = Halt::new(stop);
        let (_, chosen) = self.chosen(request, stop, &halt)?;
        Some(self.plan_of(chosen, request))
    }

    /// The choice, with what made it; none where `halt` ends it before there is one.
    fn chosen<'a>(&'a self, request: &'a Request, stop: Stop<'a>, halt: &Halt<'_>) -> Option<(Chooser<'a>, Chosen)> {
        let chooser = Chooser::new(self, request, stop, halt)?;
        let chosen = chooser.choose(halt)?;
        Some((chooser, chosen))
    }

    /// For every number of points from the fewest on the plan with the largest smallest clearance, until more points
    /// give no more.
    #[must_use]
    pub fn trade_off(&self, request: &Request, stop: Stop<'_>) -> Vec<Plan> {
        let chosen = self.chosen(request, stop, &Halt::new(&never));
        let (chooser, mut chosen) = chosen.unwrap_or_else(nobody_halts);
        let mut plans = vec![self.plan_of(chosen.clone(), request)];
        let roomiest = chooser.clearance_max(&Halt::new(&never));
        // A pair needs no more points than all polygons need without thought: one less than there are, for each point
        // of separation.
        let most = request.separation.max(1) * self.polygons.len();
        for size in chosen.choice.elements.len() + 1..most {
            if chosen.clearance(self) >= roomiest || stop.stops() {
                break;
            }
            let before = chosen.clearance(self);
            chosen = chooser.roomiest(chosen, size);
            if chosen.clearance(self) > before {
                plans.push(self.plan_of(chosen.clone(), request));
            }
        }
        plans
    }

    fn plan_of(&self, chosen: Chosen, request: &Request) -> Plan {
        let points: Vec<Circle> = chosen.choice.elements.iter().map(|&element| self.measured(element)).collect();
        let has = |polygon: usize| {
            chosen.choice.elements.iter().map(move |&element| self.candidates[element].inside.row().has(polygon))
        };
        Plan {
            signatures: (0..self.polygons.len()).map(|polygon| has(polygon).collect()).collect(),
            regions: self.areas.iter().filter(|area| **area > request.min_area || request.min_area == 0.0).count(),
            lower_bound: chosen.choice.lower_bound,
            proof: chosen.choice.proof,
            clearance_bound: chosen.clearance_bound,
            indistinguishable: chosen.indistinguishable,
            points,
        }
    }

    /// A point with its distance to the nearest edge of all.
    fn measured(&self, element: usize) -> Circle {
        let centre = self.candidates[element].circle.centre;
        let edges = self.polygons.iter().flat_map(SimplePolygon::edges);
        let radius = edges.map(|(start, end)| distance_to_segment(centre, start, end)).fold(f64::INFINITY, f64::min);
        Circle { centre, radius }
    }
}

fn nobody_halts<T>() -> T {
    unreachable!("nobody wishes it to halt")
}

/// Sorted by clearance, the largest first; none where one should halt before.
fn roomiest_first(candidates: Vec<Candidate>, halt: &Halt<'_>) -> Option<Vec<Candidate>> {
    let radii = candidates.iter().map(|candidate| candidate.circle.radius).enumerate();
    let mut order: Vec<(usize, f64)> = radii.collect();
    halt.sort_by(&mut order, |a, b| b.1.total_cmp(&a.1))?;
    let (mut looks, mut unsorted) = (halt.now_and_then(), candidates.into_iter().map(Some).collect::<Vec<_>>());
    let mut sorted = Vec::with_capacity(order.len());
    for (place, _) in order {
        looks.goes_on()?;
        sorted.extend(unsorted[place].take());
    }
    Some(sorted)
}

/// What was chosen, with all that is to be said about it.
#[derive(Clone, Debug, Default)]
struct Chosen {
    choice: Choice,
    clearance_bound: Option<f64>,
    indistinguishable: Vec<[usize; 2]>,
}

impl Chosen {
    fn clearance(&self, scene: &Scene) -> f64 {
        let radii = self.choice.elements.iter().map(|&element| scene.candidates[element].circle.radius);
        radii.fold(f64::INFINITY, f64::min)
    }
}

/// Chooses among the candidates of a scene.
struct Chooser<'a> {
    scene: &'a Scene,
    request: &'a Request,
    stop: Stop<'a>,
    /// One polygon of each class of polygons that nothing tells apart.
    system: SetSystem,
    /// Candidates allowed, the roomiest first.
    order: Vec<usize>,
    indistinguishable: Vec<[usize; 2]>,
}

impl<'a> Chooser<'a> {
    /// None where it should halt before.
    fn new(scene: &'a Scene, request: &'a Request, stop: Stop<'a>, halt: &Halt<'_>) -> Option<Self> {
        let roomy = |candidate: &Candidate| {
            candidate.circle.radius >= request.min_clearance
                && (candidate.area > request.min_area || request.min_area == 0.0)
        };
        let order: Vec<usize> = (0..scene.candidates.len()).filter(|&index| roomy(&scene.candidates[index])).collect();
        let mut looks = halt.now_and_then();
        let inside = |&index: &usize| looks.goes_on().map(|()| scene.candidates[index].inside.clone());
        let allowed = order.iter().map(inside).collect::<Option<_>>()?;
        let allowed = SetSystem::new(scene.polygons.len(), allowed);
        let indistinguishable = allowed.halting_closer_than(request.separation.max(1), halt)?;
        // One of each class that nothing tells apart stands for all. Being merely close is no class: see `Demands`.
        let mut repeats = vec![false; scene.polygons.len()];
        allowed.halting_closer_than(1, halt)?.iter().for_each(|&[_, later]| repeats[later] = true);
        let kept: Vec<usize> = (0..repeats.len()).filter(|&polygon| !repeats[polygon]).collect();
        let reduced = |inside: &BitSet| {
            let places =
                kept.iter().enumerate().filter(|(_, polygon)| inside.row().has(**polygon)).map(|(place, _)| place);
            BitSet::of(kept.len(), places)
        };
        // Elements that are not allowed keep their place, and tell nothing apart.
        let mut holders = vec![BitSet::new(kept.len()); scene.candidates.len()];
        for &index in &order {
            halt.goes_on()?;
            holders[index] = reduced(&scene.candidates[index].inside);
        }
        Some(Self { scene, request, stop, system: SetSystem::new(kept.len(), holders), order, indistinguishable })
    }

    /// None where `halt` ends it before there is a choice.
    fn choose(&self, halt: &Halt<'_>) -> Option<Chosen> {
        let effort = if self.request.objective == Objective::Greedy { Effort::Greedy } else { Effort::Full };
        let choice = halting_fewest(&self.system, &self.order, &self.search(0, effort), halt)?;
        let size = choice.elements.len();
        let chosen = Chosen { choice, clearance_bound: None, indistinguishable: self.indistinguishable.clone() };
        Some(if effort == Effort::Greedy || size == 0 { chosen } else { self.roomiest(chosen, size) })
    }

    fn search(&self, target: usize, effort: Effort) -> Search<'a> {
        Search { separation: self.request.separation, target, effort, stop: self.stop }
    }

    /// The choice of so many candidates with the largest smallest clearance: by halving the range of clearances that
    /// may be the least allowed, since what is possible with a larger one is with a smaller.
    fn roomiest(&self, mut best: Chosen, size: usize) -> Chosen {
        let radius = |place: usize| self.scene.candidates[self.order[place]].circle.radius;
        let allowed =
            |least: f64| self.order.partition_point(|&index| self.scene.candidates[index].circle.radius >= least);
        let halt = Halt::new(self.stop);
        let limit = self.clearance_max(&halt);
        // Between these numbers of the roomiest candidates is the least that is enough: `enough` is, and below
        // `refuted` none is.
        let (mut enough, mut open, mut refuted) =
            (allowed(best.clearance(self.scene)), allowed(limit) - 1, allowed(limit) - 1);
        while open + 1 < enough && !halt.is_wished() {
            let tried = allowed(radius((open + enough) / 2));
            let tried = if tried >= enough { (open + enough) / 2 } else { tried };
            let found = halting_fewest(&self.system, &self.order[..tried], &self.search(size, Effort::Brief), &halt);
            let Some(found) = found else { break };
            let separates = self.system.halting_keeps_apart(&found.elements, self.request.separation.max(1), &halt);
            let Some(separates) = separates else { break };
            if found.elements.len() <= size && separates {
                best.choice.elements = found.elements;
                enough = allowed(best.clearance(self.scene)).min(tried);
            } else {
                if found.lower_bound > size && refuted == open {
                    refuted = tried;
                }
                open = tried;
            }
        }
        // The next candidate after those refuted is the roomiest that can be the least.
        best.clearance_bound = Some(radius(refuted.min(enough - 1)).min(limit));
        best
    }

    /// The largest clearance at which candidates are left that tell all apart, whatever their number; where it should
    /// halt before that is known, the largest of all.
    fn clearance_max(&self, halt: &Halt<'_>) -> f64 {
        let least = self.request.separation.max(1);
        let separated = |count: usize| self.system.halting_keeps_apart(&self.order[..count], least, halt);
        let (mut short, mut enough) = (0, self.order.len());
        while short + 1 < enough {
            let middle = (short + enough) / 2;
            match separated(middle) {
                Some(true) => enough = middle,
                Some(false) => short = middle,
                None => enough = 1,
            }
        }
        self.order.get(enough.saturating_sub(1)).map_or(0.0, |&index| self.scene.candidates[index].circle.radius)
    }
}

/// The longer side of the box around polygons, and their distance from the origin: what rounding is relative to.
fn extent(polygons: &[SimplePolygon]) -> f64 {
    let coordinates = polygons.iter().flat_map(|polygon| polygon.vertices()).flat_map(|p| [p.x.abs(), p.y.abs()]);
    coordinates.fold(0.0, f64::max)
}

/// Whether a polygon contains a point, exactly; none for a point on an edge.
#[must_use]
pub fn contains(polygon: &SimplePolygon, point: Point2<f64>) -> Option<bool> {
    let mut inside = false;
    for (start, end) in polygon.edges() {
        if start.y.max(end.y) < point.y || start.y.min(end.y) > point.y {
            continue;
        }
        let (side, _) = turn(start, end, point);
        let within = |a: f64, b: f64, value: f64| a.min(b) <= value && value <= a.max(b);
        if side == 0.0 && within(start.x, end.x, point.x) && within(start.y, end.y, point.y) {
            return None;
        }
        if (start.y > point.y) != (end.y > point.y) && (side > 0.0) == (end.y > start.y) {
            inside = !inside;
        }
    }
    Some(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block([left, right]: [f64; 2]) -> SimplePolygon {
        SimplePolygon::new([[left, 0.0], [right, 0.0], [right, 1.0], [left, 1.0]].map(Point2::from)).unwrap()
    }

    /// The second and the third are too close to each other for three points; the first is far enough from both.
    #[test]
    fn being_too_close_is_not_passed_on() {
        let blocks = [[0.0, 1.0], [2.0, 4.0], [3.0, 5.0]].map(block);
        for objective in [Objective::Fewest, Objective::Greedy] {
            let plan = plan(&blocks, &Request { separation: 3, objective, ..Request::default() }, &|| false);
            assert_eq!(plan.indistinguishable, [[1, 2]]);
            let differ =
                |[a, b]: [usize; 2]| plan.signatures[a].iter().zip(&plan.signatures[b]).filter(|(a, b)| a != b).count();
            assert_eq!([[0, 1], [0, 2], [1, 2]].map(differ), [3, 3, 2], "{:?}", plan.signatures);
            assert_eq!((plan.points.len(), plan.is_fewest()), (4, objective == Objective::Fewest));
        }
    }
}
