//! Tests of grid, matcher and descriptors.

use proptest::prelude::*;
use stillpoint_features::{
    BestTwo, Descriptor, FeatureGrid, RotationHistogram, Searched, Window, best_two,
    match_brute_force,
};

const BOUNDS: [f32; 4] = [-10.0, -5.0, 630.0, 470.0];

fn descriptors(count: usize) -> impl Strategy<Value = Vec<Descriptor>> {
    // Few bits, so that distances repeat and ties occur.
    prop::collection::vec(any::<[u8; 2]>(), count).prop_map(|all| {
        let wide = |[a, b]: [u8; 2]| Descriptor([u64::from(a), 0, u64::from(b) << 50, 0]);
        all.into_iter().map(wide).collect()
    })
}

/// Positions, some out of bounds, with levels and descriptors.
fn scenes() -> impl Strategy<Value = (Vec<[f32; 2]>, Vec<u8>, Vec<Descriptor>)> {
    (0_usize..120).prop_flat_map(|count| {
        let position = (-40.0_f32..680.0, -40.0_f32..520.0).prop_map(|(x, y)| [x, y]);
        (
            prop::collection::vec(position, count),
            prop::collection::vec(0_u8..8, count),
            descriptors(count),
        )
    })
}

fn windows() -> impl Strategy<Value = Window> {
    (
        -60.0_f32..700.0,
        -60.0_f32..540.0,
        0.0_f32..200.0,
        0_u8..8,
        0_u8..8,
    )
        .prop_map(|(x, y, radius, a, b)| Window {
            x,
            y,
            radius,
            min_level: a.min(b),
            max_level: a.max(b),
        })
}

fn searched<'a>(
    grid: &'a FeatureGrid,
    positions: &'a [[f32; 2]],
    descriptors: &'a [Descriptor],
) -> Searched<'a> {
    Searched {
        grid,
        positions,
        descriptors,
    }
}

fn inside(window: &Window, position: [f32; 2], level: u8) -> bool {
    let (dx, dy) = (position[0] - window.x, position[1] - window.y);
    dx * dx + dy * dy <= window.radius * window.radius
        && (window.min_level..=window.max_level).contains(&level)
}

proptest! {
    #[test]
    fn grid_search_equals_exhaustive_search(
        (positions, levels, _) in scenes(), window in windows(),
    ) {
        let grid = FeatureGrid::build(&positions, &levels, BOUNDS);
        prop_assert_eq!(grid.len(), positions.len());
        let mut found = Vec::new();
        let range = window.min_level..=window.max_level;
        grid.for_each_in(&positions, window.x, window.y, window.radius, range, |index| found.push(index));
        found.sort_unstable();
        let expected: Vec<u32> = (0..positions.len())
            .filter(|&i| inside(&window, positions[i], levels[i]))
            .map(|i| i as u32)
            .collect();
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn best_two_equal_exhaustive_search(
        (positions, levels, descriptors) in scenes(), window in windows(), odd_only in any::<bool>(),
    ) {
        let grid = FeatureGrid::build(&positions, &levels, BOUNDS);
        let query = Descriptor([0x0f, 0, 0x33 << 50, 0]);
        let accept = |index: u32| !odd_only || index % 2 == 1;
        let found = best_two(&searched(&grid, &positions, &descriptors), &window, &query, accept);
        let mut distances: Vec<u32> = (0..positions.len())
            .filter(|&i| inside(&window, positions[i], levels[i]) && accept(i as u32))
            .map(|i| query.distance(&descriptors[i]))
            .collect();
        distances.sort_unstable();
        prop_assert_eq!(found.map(|best| best.distance), distances.first().copied());
        if let Some(BestTwo { index, distance, second_distance, .. }) = found {
            prop_assert_eq!(query.distance(&descriptors[index as usize]), distance);
            prop_assert!(accept(index));
            prop_assert_eq!(second_distance, distances.get(1).copied().unwrap_or(u32::MAX));
        }
    }

    #[test]
    fn rebuilt_grid_equals_a_new_grid(
        (old_positions, old_levels, _) in scenes(), (positions, levels, _) in scenes(),
    ) {
        let mut grid = FeatureGrid::build(&old_positions, &old_levels, [0.0, 0.0, 100.0, 900.0]);
        grid.rebuild(&positions, &levels, BOUNDS);
        let fresh = FeatureGrid::build(&positions, &levels, BOUNDS);
        let list = |grid: &FeatureGrid| {
            let mut all = Vec::new();
            grid.for_each_in(&positions, 300.0, 200.0, 1e4, 0..=255, |index| all.push(index));
            all
        };
        prop_assert_eq!(list(&grid), list(&fresh));
    }

    #[test]
    fn mutual_matches_are_nearest_both_ways(
        query in (0_usize..30).prop_flat_map(descriptors),
        train in (0_usize..30).prop_flat_map(descriptors),
        limit in 0_u32..12,
    ) {
        let found = match_brute_force(&query, &train, limit, 1.0);
        prop_assert_eq!(found.len(), query.len());
        let nearest = |to: &Descriptor, all: &[Descriptor]| {
            (0..all.len()).min_by_key(|&i| (to.distance(&all[i]), i))
        };
        for (q, found) in found.iter().enumerate() {
            let expected = nearest(&query[q], &train).filter(|&t| {
                query[q].distance(&train[t]) <= limit && nearest(&train[t], &query) == Some(q)
            });
            prop_assert_eq!(found.map(|t| t as usize), expected);
        }
    }

    #[test]
    fn distance_is_the_hamming_distance(a in any::<[u64; 4]>(), b in any::<[u64; 4]>()) {
        let bit = |words: &[u64; 4], i: usize| words[i / 64] >> (i % 64) & 1;
        let expected = (0..256).filter(|&i| bit(&a, i) != bit(&b, i)).count();
        prop_assert_eq!(Descriptor(a).distance(&Descriptor(b)) as usize, expected);
    }
}

#[test]
fn second_best_match_includes_its_level() {
    let positions = [[100.0, 100.0], [101.0, 100.0], [100.0, 103.0]];
    let grid = FeatureGrid::build(&positions, &[2, 3, 4], BOUNDS);
    let all = [
        Descriptor([0b111, 0, 0, 0]),
        Descriptor([0b1, 0, 0, 0]),
        Descriptor([0b11, 0, 0, 0]),
    ];
    let window = Window {
        x: 100.0,
        y: 100.0,
        radius: 5.0,
        min_level: 0,
        max_level: 7,
    };
    let best = best_two(
        &searched(&grid, &positions, &all),
        &window,
        &Descriptor::default(),
        |_| true,
    );
    let expected = BestTwo {
        index: 1,
        distance: 1,
        second_distance: 2,
        second_level: 4,
    };
    assert_eq!(best, Some(expected));
}

#[test]
fn close_second_best_fails_the_ratio_test() {
    let query = [Descriptor([0, 0, 0, 0])];
    let train = [
        Descriptor([0b1111, 0, 0, 0]),
        Descriptor([0b11111, 0, 0, 0]),
    ];
    assert_eq!(match_brute_force(&query, &train, 50, 0.9), [Some(0)]);
    assert_eq!(match_brute_force(&query, &train, 50, 0.7), [None]);
    assert_eq!(match_brute_force(&query, &train[..1], 50, 0.7), [Some(0)]);
    assert_eq!(match_brute_force(&query, &train, 3, 1.0), [None]);
}

#[test]
fn non_finite_positions_are_ignored() {
    let positions = [[f32::NAN, 1.0], [5.0, 5.0], [f32::INFINITY, 0.0]];
    let grid = FeatureGrid::build(&positions, &[0; 3], BOUNDS);
    let mut found = Vec::new();
    grid.for_each_in(&positions, 5.0, 5.0, 1e9, 0..=7, |index| found.push(index));
    assert_eq!(found, [1]);
    grid.for_each_in(&positions, f32::NAN, 5.0, 10.0, 0..=7, |_| {
        panic!("nothing is near nowhere")
    });
}

#[test]
fn rotation_histogram_keeps_the_three_fullest_bins() {
    let mut histogram = RotationHistogram::new();
    let tau = std::f32::consts::TAU;
    // Around 0 (from both sides, and a turn further), around 90 degrees, and one at 200 degrees.
    for item in 0..30 {
        histogram.push([0.05, -0.05, tau + 0.03, -tau - 0.03][item % 4], item);
    }
    for item in 100..110 {
        histogram.push(tau / 4.0 + 0.01, item);
    }
    histogram.push(3.5, 999);
    let kept: Vec<_> = histogram.kept().collect();
    let expected: Vec<_> = (0..30).chain(100..110).collect();
    assert_eq!(kept, expected);
    assert_eq!(histogram.dropped().collect::<Vec<_>>(), [999]);
    histogram.clear();
    assert_eq!(histogram.kept().count(), 0);
}

#[test]
fn medoid_is_the_central_descriptor() {
    let of = |bits: u64| Descriptor([bits, 0, 0, 0]);
    let all = [of(0b1111_1111), of(0b1), of(0b11), of(0b111), of(0)];
    assert_eq!(Descriptor::medoid(&all), Some(of(0b1)));
    assert_eq!(Descriptor::medoid(&all[..1]), Some(all[0]));
    assert_eq!(Descriptor::medoid(&[]), None);
}
