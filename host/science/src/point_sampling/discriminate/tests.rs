//! The solver against exhaustive search, and the thesis's reductions (§3.2, §3.4, §3.5, appendix B).

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use proptest::prelude::*;

use super::cuts::Cuts;
use super::partition::{Order, Outcome, Partition, distances};
use super::system::Columns;
use super::*;
use crate::geometry::SimplePolygon;
use crate::math::bits::BitSet;
use crate::math::random::Draw;
use crate::point_sampling::reductions::{self, Graph, path_length};
use crate::point_sampling::scenes::SceneKind;
use crate::point_sampling::{Request, Subdivision, plan};

fn all(system: &SetSystem) -> Vec<usize> {
    (0..system.elements()).collect()
}

fn solve(system: &SetSystem, separation: usize) -> Choice {
    fewest(system, &all(system), &Search { separation, target: 0, effort: Effort::Full, stop: &|| false })
}

/// Subsets of `0..count`, smallest first.
fn subsets(count: usize) -> Vec<Vec<usize>> {
    let mut subsets: Vec<Vec<usize>> =
        (0..1_usize << count).map(|mask| (0..count).filter(|bit| mask >> bit & 1 == 1).collect()).collect();
    subsets.sort_by_key(Vec::len);
    subsets
}

/// The size of the smallest choice, by trying all; sets are compared as sets of elements. None where `separation` is 1
/// and two sets are equal.
fn by_exhaustion(system: &SetSystem, separation: usize) -> Option<usize> {
    let sets: Vec<BTreeSet<usize>> = (0..system.sets())
        .map(|set| (0..system.elements()).filter(|&element| system.holders(element).has(set)).collect())
        .collect();
    let enough = |choice: &Vec<usize>| {
        let differ = |a: &BTreeSet<usize>, b: &BTreeSet<usize>| {
            let demand = if separation > 1 { a.symmetric_difference(b).count().min(separation) } else { 1 };
            choice.iter().filter(|element| a.contains(element) != b.contains(element)).count() >= demand
        };
        (0..sets.len()).all(|i| (0..i).all(|j| differ(&sets[i], &sets[j])))
    };
    subsets(system.elements()).iter().find(|choice| enough(choice)).map(Vec::len)
}

/// The sets of regions that polygons are, each kind of region once.
fn regions(polygons: &[SimplePolygon]) -> SetSystem {
    let subdivision = Subdivision::new(polygons);
    let kinds: BTreeSet<Vec<usize>> = subdivision.regions().map(|region| region.inside().iter().collect()).collect();
    let holders = kinds.into_iter().map(|kind| BitSet::of(polygons.len(), kind)).collect();
    SetSystem::new(polygons.len(), holders)
}

/// Sparse and dense systems, some of separate parts.
fn systems(sets: std::ops::Range<usize>, elements: usize) -> impl Strategy<Value = SetSystem> {
    (sets, 0..4_u32).prop_flat_map(move |(sets, density)| {
        let holder = proptest::collection::vec(0..4_u32, sets).prop_map(move |draws| {
            BitSet::of(draws.len(), (0..draws.len()).filter(|&set| draws[set] <= density.saturating_sub(1)))
        });
        proptest::collection::vec(holder, 1..elements).prop_map(move |holders| SetSystem::new(sets, holders))
    })
}

proptest! {
    #[test]
    fn the_fewest_are_as_few_as_exhaustive_search_finds(system in systems(2..9, 11), separation in 1..4_usize) {
        let Some(least) = by_exhaustion(&system, separation) else {
            prop_assert!(!system.closer_than(separation).is_empty());
            return Ok(());
        };
        let choice = solve(&system, separation);
        prop_assert!(system.keeps_apart(&choice.elements, separation));
        prop_assert_eq!((choice.elements.len(), choice.lower_bound), (least, least), "{:?}", choice);
    }

    /// A search that was broken off anywhere proves no more than it had, and what it chose does what it must.
    #[test]
    fn a_search_broken_off_claims_nothing_that_exhaustive_search_denies(
        system in systems(2..10, 12), separation in 1..3_usize, looks in 0..40_usize, target in 0..4_usize,
    ) {
        let Some(least) = by_exhaustion(&system, separation) else { return Ok(()) };
        let asked = AtomicUsize::new(0);
        let stop = || asked.fetch_add(1, Relaxed) >= looks;
        for effort in [Effort::Greedy, Effort::Brief, Effort::Full] {
            let choice = fewest(&system, &all(&system), &Search { separation, target, effort, stop: &stop });
            prop_assert!(system.keeps_apart(&choice.elements, separation));
            prop_assert!(choice.lower_bound <= least && choice.elements.len() >= least, "{choice:?} where {least} are enough");
        }
    }

    /// The search over partitions by itself: sets that few columns tell apart, so that every one of its bounds decides
    /// somewhere.
    #[test]
    fn so_many_columns_are_enough_exactly_if_some_of_all_choices_are(
        holders in (2..16_usize).prop_flat_map(|sets| proptest::collection::vec(1..1_u32 << sets, 1..11).prop_map(move |holders| (sets, holders))),
        first_most in proptest::bool::ANY,
    ) {
        let (sets, holders) = holders;
        let of = |mask: &u32| BitSet::of(sets, (0..sets).filter(|set| mask >> set & 1 == 1));
        let system = SetSystem::new(sets, holders.iter().map(of).collect());
        let columns = Columns::of_all(&system, &all(&system));
        let least = by_exhaustion(&system, 1);
        let order = if first_most { Order::Most } else { Order::Fewest };
        for size in 0..=columns.len() {
            match Partition::new(u64::MAX, order, &|| false).search(&columns, size) {
                Outcome::Found(found) => {
                    let elements: Vec<usize> = found.iter().map(|&column| columns.elements[column]).collect();
                    prop_assert!(elements.len() <= size && system.tells_apart(&elements), "{:?}", elements);
                }
                outcome => {
                    prop_assert_eq!(outcome, Outcome::Refuted);
                    prop_assert!(least.is_none_or(|least| least > size), "{} of {:?} refuted", size, least);
                }
            }
        }
    }

    /// Many small parts: what [`fewest`] solves one by one.
    #[test]
    fn parts_solved_one_by_one_need_no_more(parts in proptest::collection::vec((1..3_usize, 1..8_usize), 2..5)) {
        let count: usize = parts.iter().map(|(sets, _)| sets).sum();
        let (mut first, mut holders) = (0, Vec::new());
        for (sets, kinds) in parts {
            let masks = [vec![0], vec![sets - 1], (0..sets).collect::<Vec<_>>()];
            holders.extend(masks.iter().enumerate().filter(|(bit, _)| kinds >> bit & 1 == 1).map(|(_, mask)| {
                BitSet::of(count, mask.iter().map(|set| first + set))
            }));
            first += sets;
        }
        let system = SetSystem::new(count, holders);
        if let Some(least) = by_exhaustion(&system, 1) {
            let choice = solve(&system, 1);
            prop_assert!(system.tells_apart(&choice.elements));
            prop_assert_eq!((choice.elements.len(), choice.lower_bound), (least, least));
        }
    }

    #[test]
    fn greedy_stays_within_its_guarantee(system in systems(2..9, 11)) {
        let Some(least) = by_exhaustion(&system, 1) else { return Ok(()) };
        let greedy = fewest(&system, &all(&system), &Search { separation: 1, target: 0, effort: Effort::Greedy, stop: &|| false });
        prop_assert!(system.tells_apart(&greedy.elements));
        let n = f64::from(u32::try_from(system.sets()).unwrap());
        let bound = (1.0 + (n * n / 4.0).floor().ln()) * f64::from(u32::try_from(least).unwrap());
        prop_assert!(f64::from(u32::try_from(greedy.elements.len()).unwrap()) <= bound + 1e-9);
    }

    /// Where a poor choice would not: 64 sets that have their six digits and an element of their own, in any order.
    #[test]
    fn greedy_stays_within_its_guarantee_where_a_poor_choice_does_not(order in Just((0..70).collect::<Vec<usize>>()).prop_shuffle()) {
        let sets: Vec<Vec<usize>> =
            (0..64).map(|i| (0..6).filter(|bit| i >> bit & 1 == 1).chain([6 + i]).map(|element| order[element]).collect()).collect();
        let system = SetSystem::from_sets(70, &sets);
        let greedy = fewest(&system, &all(&system), &Search { separation: 1, target: 0, effort: Effort::Greedy, stop: &|| false });
        prop_assert!(system.tells_apart(&greedy.elements));
        let bound = (1.0 + (64.0_f64 * 64.0 / 4.0).ln()) * 6.0;
        let own: Vec<usize> = (6..69).map(|element| order[element]).collect();
        prop_assert!(system.tells_apart(&own) && own.len() as f64 > bound);
        prop_assert!(greedy.elements.len() as f64 <= bound, "{}", greedy.elements.len());
    }

    #[test]
    fn every_choice_that_tells_apart_keeps_every_counting_row(system in systems(2..9, 9), group in 1..512_usize) {
        let columns = Columns::of_all(&system, &all(&system));
        let group = BitSet::of(system.sets(), (0..system.sets()).filter(|set| group >> set & 1 == 1));
        prop_assume!(group.row().count() > 1);
        let row = Cuts::new(&columns).counting_row(&group);
        for choice in subsets(columns.len()) {
            let elements: Vec<usize> = choice.iter().map(|&column| columns.elements[column]).collect();
            let apart = group.row().iter().map(|set| system.code(set, &elements)).collect::<BTreeSet<_>>().len() == group.row().count();
            let sum: f64 = row.terms.iter().filter(|(column, _)| choice.contains(&(*column as usize))).map(|(_, value)| value).sum();
            prop_assert!(!apart || sum >= row.right, "{:?} {} {}", choice, sum, row.right);
        }
    }

    #[test]
    fn questions_find_every_set_and_are_as_few_as_can_be(system in systems(2..7, 7)) {
        prop_assume!(system.closer_than(1).is_empty());
        let search = Search { separation: 1, target: 0, effort: Effort::Full, stop: &|| false };
        let (tree, bound) = questions(&system, &all(&system), &search);
        for set in 0..system.sets() {
            let mut at = &tree;
            while let Question::Ask { element, yes, no } = at {
                at = if system.holders(*element).has(set) { yes } else { no };
            }
            prop_assert_eq!(at, &Question::Answer(vec![set]));
        }
        let least = depth_by_exhaustion(&system, &(0..system.sets()).collect::<Vec<_>>());
        prop_assert_eq!((tree.depth(), bound), (least, least));
        prop_assert!(system.tells_apart(&tree.elements()));
    }
}

fn depth_by_exhaustion(system: &SetSystem, sets: &[usize]) -> usize {
    if sets.len() <= 1 {
        return 0;
    }
    let depth = |element: usize| {
        let (yes, no): (Vec<usize>, Vec<usize>) = sets.iter().partition(|&&set| system.holders(element).has(set));
        (!yes.is_empty() && !no.is_empty())
            .then(|| 1 + depth_by_exhaustion(system, &yes).max(depth_by_exhaustion(system, &no)))
    };
    (0..system.elements()).filter_map(depth).min().unwrap()
}

/// The sets by some of their elements alone.
fn by_elements(sets: &[Vec<usize>], elements: &[usize]) -> SetSystem {
    let kept =
        |set: &Vec<usize>| (0..elements.len()).filter(|&place| set.contains(&elements[place])).collect::<Vec<_>>();
    SetSystem::from_sets(elements.len(), &sets.iter().map(kept).collect::<Vec<_>>())
}

/// Least number of questions for elements that tell all sets apart, by trying all; none where they do not.
fn questions_for(sets: &[Vec<usize>], elements: &[usize]) -> Option<usize> {
    let system = by_elements(sets, elements);
    let numbers: Vec<_> = (0..sets.len()).collect();
    system.closer_than(1).is_empty().then(|| depth_by_exhaustion(&system, &numbers))
}

/// How few elements tell the sets apart, the fewest questions for any such choice, and for all elements: by trying all.
fn fewest_and_shallowest(sets: &[Vec<usize>], elements: usize) -> Option<(usize, usize, usize)> {
    let depths: Vec<(usize, usize)> =
        subsets(elements).iter().filter_map(|chosen| Some((chosen.len(), questions_for(sets, chosen)?))).collect();
    let fewest = depths.iter().map(|(size, _)| *size).min()?;
    let of_fewest = depths.iter().filter(|(size, _)| *size == fewest).map(|(_, depth)| *depth).min()?;
    Some((fewest, of_fewest, depths.iter().map(|(_, depth)| *depth).min()?))
}

/// The sets without one of their memberships, each in turn.
fn with_one_less(sets: &[Vec<usize>]) -> Vec<Vec<Vec<usize>>> {
    let places = (0..sets.len()).flat_map(|set| (0..sets[set].len()).map(move |place| (set, place)));
    let without = |(set, place): (usize, usize)| {
        let mut fewer = sets.to_vec();
        fewer[set].remove(place);
        fewer
    };
    places.map(without).collect()
}

/// Footnote 7 says two things of its example that are true, and concludes one that is not.
#[test]
fn footnote_7s_example_has_few_elements_and_shallow_questions_at_once() {
    // a b c d a' b' c' d' e'
    let sets = [vec![0, 1, 4, 8], vec![0, 4], vec![1, 5, 7], vec![2, 5], vec![3, 6], vec![]];
    let (plain, primed, mixed) = ([0, 1, 2, 3], [4, 5, 6, 7, 8], [0, 1, 3, 5]);
    let told = |sets: &[Vec<usize>]| {
        let of = |elements: &[usize]| questions_for(sets, elements);
        (fewest_and_shallowest(sets, 9), of(&plain), of(&primed), of(&mixed))
    };
    let footnote = told(&sets);
    // a, b, c, d are as few as there can be and take four questions, the five primed ones three, as few as there can be.
    // But a, b, d, b' are four, too, and take three: ask b' first.
    assert_eq!(footnote, (Some((4, 3, 3)), Some(4), Some(3), Some(3)));
    let system = SetSystem::from_sets(9, &sets);
    assert_eq!(solve(&system, 1).elements.len(), 4);
    let search = Search { separation: 1, target: 0, effort: Effort::Full, stop: &|| false };
    let depth = |elements: &[usize]| questions(&system, elements, &search).0.depth();
    assert_eq!([&all(&system)[..], &plain, &mixed].map(depth), [3, 4, 3]);
    // Each membership is needed for that.
    assert!(with_one_less(&sets).iter().all(|fewer| told(fewer) != footnote));
}

/// What footnote 7 concludes holds of another example: no choice of as few elements as can be is asked in as few questions
/// as can be.
#[test]
fn few_elements_and_shallow_questions_may_exclude_each_other() {
    // {a}, {a, b}, {a, c}, {d}, {d, e}, {e}
    let sets = [vec![0], vec![0, 1], vec![0, 2], vec![3], vec![3, 4], vec![4]];
    assert_eq!(fewest_and_shallowest(&sets, 5), Some((4, 4, 3)));
    let system = SetSystem::from_sets(5, &sets);
    let search = Search { separation: 1, target: 0, effort: Effort::Full, stop: &|| false };
    let (tree, bound) = questions(&system, &all(&system), &search);
    assert_eq!((tree.depth(), bound, tree.elements().len()), (3, 3, 5));
    let few = solve(&system, 1).elements;
    assert_eq!((few.len(), questions(&system, &few, &search).0.depth()), (4, 4));
    assert!(with_one_less(&sets).iter().all(|fewer| fewest_and_shallowest(fewer, 5) != Some((4, 4, 3))));
}

#[test]
fn figure_3_2_needs_its_bounds_as_sets() {
    // (a) ⌈log n⌉ elements are enough; (b) nested sets need n − 1.
    let n = 13;
    let digits = |i: usize| (0..4).filter(move |bit| i >> bit & 1 == 1);
    let spread: Vec<Vec<usize>> = (0..n).map(|i| digits(i).chain(4..5 + i).collect()).collect();
    assert_eq!(solve(&SetSystem::from_sets(4 + n, &spread), 1).elements.len(), 4);
    let nested: Vec<Vec<usize>> = (0..n).map(|i| (0..=i).collect()).collect();
    assert_eq!(solve(&SetSystem::from_sets(n, &nested), 1).elements.len(), n - 1);
}

#[test]
fn as_many_sets_as_fit_a_mask_are_told_apart_by_their_digits() {
    let sets: Vec<Vec<usize>> =
        (0..64_usize).map(|i| (0..6).filter(|bit| i >> bit & 1 == 1).chain(6..6 + i).collect()).collect();
    let system = SetSystem::from_sets(6 + 63, &sets);
    let columns = Columns::of_all(&system, &all(&system));
    let search = |size| Partition::new(u64::MAX, Order::Fewest, &|| false).search(&columns, size);
    assert_eq!(search(5), Outcome::Refuted);
    let Outcome::Found(found) = search(6) else { panic!("6 digits are enough") };
    assert!(system.tells_apart(&found.iter().map(|&column| columns.elements[column]).collect::<Vec<_>>()));
}

#[test]
fn sets_that_are_equal_are_named() {
    let system = SetSystem::from_sets(2, &[vec![0], vec![1], vec![0], vec![0]]);
    assert_eq!(system.closer_than(1), [[0, 2], [0, 3], [2, 3]]);
    assert!(!system.tells_apart(&solve(&system, 1).elements));
}

/// Codes may be turned round in every bit, so a state is how many codes are in each class still equal; a bit takes some
/// of each. Shares nothing with the bound but what is asked.
fn least_distances(classes: Vec<u32>, known: &mut std::collections::HashMap<Vec<u32>, u32>) -> u32 {
    let mut open: Vec<u32> = classes.into_iter().filter(|&size| size > 1).collect();
    open.sort_unstable();
    if open.is_empty() {
        return 0;
    }
    if let Some(&least) = known.get(&open) {
        return least;
    }
    let mut least = u32::MAX;
    let combinations = open.iter().map(|size| size + 1).product::<u32>();
    for mut number in 1..combinations {
        let taken: Vec<u32> = open
            .iter()
            .map(|size| {
                let taken = number % (size + 1);
                number /= size + 1;
                taken
            })
            .collect();
        if open.iter().zip(&taken).all(|(size, taken)| *taken == 0 || taken == size) {
            continue;
        }
        let finer = open.iter().zip(&taken).flat_map(|(size, taken)| [*taken, size - taken]).collect();
        // Codes already alone are left out of the sum here, which can only make it smaller.
        let ones: u32 = taken.iter().sum();
        let all: u32 = open.iter().sum();
        least = least.min(ones * (all - ones) + least_distances(finer, known));
    }
    known.insert(open, least);
    least
}

#[test]
fn codes_cannot_be_closer_than_the_bound_of_the_partition_search() {
    // Exhaustive over codes of up to four bits: the least sum of distances of `count` different codes.
    let exact = |count: u32, bits: usize| {
        let sum = |codes: &[u32]| -> u32 {
            codes.iter().enumerate().flat_map(|(i, a)| codes[..i].iter().map(move |b| (a ^ b).count_ones())).sum()
        };
        let all = 1_u32 << bits;
        let choices = (0..1_u32 << all).filter(|mask| mask.count_ones() == count);
        choices.map(|mask| sum(&(0..all).filter(|code| mask >> code & 1 == 1).collect::<Vec<_>>())).min().unwrap()
    };
    for bits in 1..=4 {
        for count in 2..=1 << bits {
            assert_eq!(distances(count, bits), exact(count, bits), "{count} codes of {bits} bits");
        }
    }
    let mut known = std::collections::HashMap::new();
    // With single codes left out of the sum it is smaller; the bound must not need more than that plus what is left
    // out.
    for count in 2..=7 {
        assert!(least_distances(vec![count], &mut known) <= distances(count, 64), "{count}");
    }
    for count in 2..64_u32 {
        assert!(distances(count, 64) >= count * (count - 1) / 2);
        // All codes of some bits: each bit divides them evenly.
        let bits = log2_ceil(count);
        let full = 1_u32 << bits;
        assert_eq!(distances(full, bits), u32::try_from(bits).unwrap() * full / 2 * (full / 2));
    }
}

/// What the reductions of graphs are asked for, by exhaustion.
trait Independence {
    fn distances(&self) -> Vec<Vec<usize>>;
    fn independent(&self, k: usize) -> usize;
    fn cover(&self) -> usize;
}

impl Independence for Graph {
    fn distances(&self) -> Vec<Vec<usize>> {
        let far = usize::MAX / 4;
        let mut distance = vec![vec![far; self.vertices]; self.vertices];
        (0..self.vertices).for_each(|v| distance[v][v] = 0);
        self.edges.iter().for_each(|&[u, v]| (distance[u][v], distance[v][u]) = (1, 1));
        for via in 0..self.vertices {
            for u in 0..self.vertices {
                for v in 0..self.vertices {
                    distance[u][v] = distance[u][v].min(distance[u][via] + distance[via][v]);
                }
            }
        }
        distance
    }

    /// The size of the largest set of vertices at distances of `k` or more.
    fn independent(&self, k: usize) -> usize {
        let distance = self.distances();
        grow(&distance, k, &mut Vec::new(), 0)
    }

    fn cover(&self) -> usize {
        self.vertices - self.independent(2)
    }
}

fn grow(distance: &[Vec<usize>], k: usize, chosen: &mut Vec<usize>, from: usize) -> usize {
    let mut most = chosen.len();
    for v in from..distance.len() {
        if chosen.iter().all(|&u| distance[u][v] >= k) {
            chosen.push(v);
            most = most.max(grow(distance, k, chosen, v + 1));
            chosen.pop();
        }
    }
    most
}

fn graphs(vertices: std::ops::Range<usize>) -> impl Strategy<Value = Graph> {
    vertices.prop_flat_map(|vertices| {
        let pairs: Vec<[usize; 2]> = (0..vertices).flat_map(|v| (0..v).map(move |u| [u, v])).collect();
        proptest::sample::subsequence(pairs.clone(), 1..=pairs.len()).prop_map(move |edges| Graph { vertices, edges })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Lemma 4 on polygons: the fewest regions, by trying all, are ⌈log₂ n⌉ to n − 1. Regions in the same polygons are one.
    #[test]
    fn lemma_4_a_region_basis_has_log_n_to_n_minus_1_regions(seed in 0..u64::MAX, count in 2..5_usize, kind in 0..3_usize) {
        let kind = [SceneKind::SPARSE_SHAPES, SceneKind::DENSE_SHAPES, SceneKind::DENSE_POSES][kind];
        let polygons = kind.draw(&mut Draw::new(seed), count);
        let least = by_exhaustion(&regions(&polygons), 1).unwrap();
        prop_assert!((log2_ceil(u32::try_from(count).unwrap())..count).contains(&least), "{least}");
        let plan = plan(&polygons, &Request::default(), &|| false);
        prop_assert_eq!((plan.points.len(), plan.lower_bound), (least, least));
    }

    /// Figure 3.2 as polygons: (a) reaches the lower bound, (b) the upper.
    #[test]
    fn lemma_4_is_tight_by_figure_3_2(count in 2..14_usize) {
        let found = |polygons: &[SimplePolygon]| {
            let plan = plan(polygons, &Request::default(), &|| false);
            assert!(plan.is_fewest() && plan.indistinguishable.is_empty() && plan.signatures.len() == count);
            (plan.points.len(), plan.regions)
        };
        let digits = log2_ceil(u32::try_from(count).unwrap());
        prop_assert_eq!(found(&reductions::digits(count)), (digits, digits + count));
        prop_assert_eq!(found(&reductions::nested(count)), (count - 1, count));
    }

    /// Theorem 6 by figure 3.3 (a), Corollary 7 by figure 3.3 (b): the polygons made of sets have a region for each element
    /// of some and not of all sets, and R(a), and need as many as the sets need elements, which all choices of elements say.
    #[test]
    fn theorem_6_and_corollary_7_discriminating_sets_reduce_to_region_bases(
        elements in 1..7_usize, sets in proptest::collection::btree_set(proptest::collection::btree_set(0..6_usize, 0..6), 2..7),
    ) {
        let within = |set: BTreeSet<usize>| set.into_iter().filter(|&element| element < elements).collect();
        let sets: BTreeSet<BTreeSet<usize>> = sets.into_iter().map(within).collect();
        // What all sets have is one region with R(a); the proof leaves that out beforehand.
        let is_told = |element: &usize| (1..sets.len()).contains(&sets.iter().filter(|set| set.contains(element)).count());
        let used = (0..elements).filter(is_told).count();
        let sets: Vec<Vec<usize>> = sets.into_iter().map(|set| set.into_iter().collect()).collect();
        let least = by_exhaustion(&SetSystem::from_sets(elements, &sets), 1).unwrap();
        let (combs, flowers) = (reductions::combs(elements, &sets), reductions::flowers(elements, &sets));
        for polygons in [&combs, &flowers] {
            prop_assert_eq!(polygons.len(), sets.len());
            let subdivision = Subdivision::new(polygons);
            prop_assert_eq!((subdivision.regions().count(), subdivision.holes()), (used + 1, 0));
            prop_assert_eq!(by_exhaustion(&regions(polygons), 1), Some(least));
            let plan = plan(polygons, &Request::default(), &|| false);
            prop_assert_eq!((plan.points.len(), plan.lower_bound), (least, least));
        }
        let is_convex = |polygon: &SimplePolygon| {
            let v = polygon.vertices();
            (0..v.len()).all(|i| (v[(i + 1) % v.len()] - v[i]).perp(&(v[(i + 2) % v.len()] - v[i])) > 0.0)
        };
        prop_assert!(flowers.iter().all(is_convex));
        prop_assert!(used == 0 || elements < 3 || !combs.iter().all(is_convex));
    }

    /// Theorem 5: a graph has a vertex cover of size l exactly if the sets have a discriminating set of size l + m − 1.
    #[test]
    fn theorem_5_vertex_cover_reduces_to_discriminating_sets(graph in graphs(2..6)) {
        let (n, m) = (graph.vertices, graph.edges.len());
        let with_ends = graph.edges.iter().enumerate().map(|(e, &[u, v])| vec![u, v, n + e]);
        let sets: Vec<Vec<usize>> = with_ends.chain((0..m).map(|e| vec![n + e])).collect();
        prop_assert_eq!(solve(&SetSystem::from_sets(n + m, &sets), 1).elements.len(), graph.cover() + m - 1);
    }

    /// Lemma 10: what a discriminating set of the edges and the empty set leaves out is a 3-independent set.
    #[test]
    fn lemma_10_edges_are_told_apart_by_what_a_3_independent_set_leaves(graph in graphs(2..9)) {
        let mut sets: Vec<Vec<usize>> = graph.edges.iter().map(|edge| edge.to_vec()).collect();
        sets.push(Vec::new());
        let choice = solve(&SetSystem::from_sets(graph.vertices, &sets), 1);
        prop_assert_eq!(choice.elements.len(), graph.vertices - graph.independent(3));
    }

    /// Lemma 11: as many vertices are independent in a graph as are 3-independent in it with midvertices.
    #[test]
    fn lemma_11_independent_sets_reduce_to_3_independent_sets(graph in graphs(2..6)) {
        prop_assert_eq!(graph.with_midvertices().independent(3), graph.independent(2));
    }

    /// Theorem 12, by Lemmas 11 and 10 one after the other: with ∅ and sets of two elements, the edges of a graph with its
    /// midvertices, a discriminating set of so many elements says how many vertices of the graph are independent.
    #[test]
    fn theorem_12_sets_of_two_elements_are_as_hard_as_independent_set(graph in graphs(2..6)) {
        let reduced = graph.with_midvertices();
        let mut sets: Vec<Vec<usize>> = reduced.edges.iter().map(|edge| edge.to_vec()).collect();
        sets.push(Vec::new());
        prop_assert!(sets.iter().all(|set| set.len() <= 2));
        let choice = solve(&SetSystem::from_sets(reduced.vertices, &sets), 1);
        prop_assert_eq!(choice.elements.len() + graph.independent(2), graph.vertices + graph.edges.len());
    }

    /// Lemma 33: the same for k > 3 by paths, with the distances that its proof names.
    #[test]
    fn lemma_33_independent_sets_reduce_to_k_independent_sets(graph in graphs(2..6), k in 4..9_usize) {
        let reduced = graph.with_paths(k);
        prop_assert_eq!(reduced.independent(k), graph.independent(2), "k = {}", k);
        let (distance, length) = (reduced.distances(), path_length(k));
        let middle = |v: usize| v * length + length / 2;
        for u in 0..graph.vertices {
            for v in 0..u {
                let is_edge = graph.edges.contains(&[v, u]) || graph.edges.contains(&[u, v]);
                let apart = distance[middle(u)][middle(v)];
                prop_assert!(if is_edge { apart == k - 1 } else { apart >= k + usize::from(k % 2 == 1) }, "{u} {v}: {apart}");
            }
        }
    }

    /// Theorem 34: for k = 1 all vertices are the answer; for each k from 2 on a graph that is no larger than
    /// (k + m)(n + m) has the answer of Independent Set.
    #[test]
    fn theorem_34_k_independent_set_is_easy_for_1_and_as_hard_as_independent_set_beyond(graph in graphs(2..6), k in 2..9_usize) {
        let (n, m) = (graph.vertices, graph.edges.len());
        prop_assert_eq!(graph.independent(1), n);
        let reduced = match k {
            2 => graph.clone(),
            3 => graph.with_midvertices(),
            _ => graph.with_paths(k),
        };
        prop_assert_eq!(reduced.independent(k), n - graph.cover());
        prop_assert!(reduced.vertices + reduced.edges.len() <= (k + m + 4) * (n + m));
    }

    /// §3.4: discriminating sets are what hits all symmetric differences; and Lemma 8, the other way, with one copy:
    /// hitting sets of T₁ … Tₙ are what tells apart Tᵢ ∪ Aᵢ and Aᵢ, beside the digits that tell the Aᵢ apart.
    #[test]
    fn lemma_8_hitting_sets_and_discriminating_sets_reduce_to_each_other(
        sets in proptest::collection::vec(proptest::collection::btree_set(0..6_usize, 1..5), 1..6),
    ) {
        let hit = |targets: &[BTreeSet<usize>]| {
            let hits = |choice: &Vec<usize>| targets.iter().all(|target| choice.iter().any(|element| target.contains(element)));
            subsets(6).iter().find(|choice| hits(choice)).map(Vec::len)
        };
        let as_vec = |set: &BTreeSet<usize>| set.iter().copied().collect::<Vec<_>>();
        let distinct: Vec<BTreeSet<usize>> = sets.iter().cloned().collect::<BTreeSet<_>>().into_iter().collect();
        let differences: Vec<BTreeSet<usize>> =
            (0..distinct.len()).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| distinct[i].symmetric_difference(&distinct[j]).copied().collect()).collect();
        let system = SetSystem::from_sets(6, &distinct.iter().map(as_vec).collect::<Vec<_>>());
        prop_assert_eq!(Some(solve(&system, 1).elements.len()), hit(&differences));

        let digits = log2_ceil(u32::try_from(sets.len()).unwrap());
        let own = |i: usize| (0..digits).filter(move |bit| i >> bit & 1 == 1).map(|bit| 6 + bit);
        let with = sets.iter().enumerate().map(|(i, set)| set.iter().copied().chain(own(i)).collect());
        let all: Vec<Vec<usize>> = with.chain((0..sets.len()).map(|i| own(i).collect())).collect();
        let least = solve(&SetSystem::from_sets(6 + digits, &all), 1).elements.len();
        prop_assert_eq!(Some(least), hit(&sets).map(|size| size + digits));
    }
}
