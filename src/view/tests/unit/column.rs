use super::*;
use proptest::prelude::*;

fn samples(values: &[f64]) -> Vec<Sample> {
    let each = values.iter().zip(0i64..);
    each.map(|(value, k)| Sample {
        at_ns: 10 * k,
        value: *value,
    })
    .collect()
}

#[test]
fn few_samples_are_shown_as_they_are_with_their_neighbours() {
    let all = samples(&[1.0, 5.0, 2.0, 7.0, 3.0]);
    assert_eq!(decimated(&all, 10, 30, 100), all);
    assert_eq!(decimated(&all, 15, 25, 100), all[1..4]);
    assert_eq!(decimated(&all, 11, 19, 100), all[1..3]);
    assert_eq!(decimated(&all, 100, 200, 100), all[4..]);
    assert!(decimated(&[], 0, 10, 10).is_empty());
}

#[test]
fn a_peak_of_one_sample_is_seen_however_wide_the_plot() {
    let mut values = vec![0.0; 100_000];
    values[73_211] = 9.0;
    values[12] = -4.0;
    let shown = decimated(&samples(&values), 0, 1_000_000, 50);
    assert!(shown.len() <= 102, "{}", shown.len());
    let peak = shown.iter().find(|s| s.value == 9.0).unwrap();
    assert_eq!(peak.at_ns, 732_110);
    assert!(shown.iter().any(|s| s.value == -4.0));
}

#[test]
fn a_column_is_bounded_and_keeps_peaks_whatever_comes() {
    let mut column = Column::holding(1000);
    for k in 0..200_000i64 {
        column.push(k, if k == 123_456 { 50.0 } else { (k % 7) as f64 });
    }
    column.push(1, f64::NAN);
    assert!(column.is_thinned() && column.not_finite() == 1);
    assert!(column.samples().len() <= 1001);
    let peak = Sample {
        at_ns: 123_456,
        value: 50.0,
    };
    assert!(column.samples().contains(&peak));
}

proptest! {
    /// What is drawn in each pixel reaches from the least to the greatest sample in it: no sample lies outside.
    #[test]
    fn the_least_and_the_greatest_of_each_pixel_hold_all_its_samples(
        steps in proptest::collection::vec((0i64..50, -1e6f64..1e6), 0..800),
        pixels in 1usize..60,
        from in -100i64..20_000,
        long in 0i64..20_000,
    ) {
        let mut at = 0;
        let all: Vec<Sample> = steps.iter().map(|(step, value)| {
            at += step;
            Sample { at_ns: at, value: *value }
        }).collect();
        let to = from + long;
        let shown = decimated(&all, from, to, pixels);
        let inside: Vec<&Sample> = all.iter().filter(|s| (from..=to).contains(&s.at_ns)).collect();
        prop_assert!(shown.len() <= 2 * pixels + 2);
        prop_assert!(shown.iter().all(|s| all.contains(s)), "each is a sample of the log");
        prop_assert!(shown.is_sorted_by_key(|s| s.at_ns));
        let width = to - from + 1;
        let pixel = |s: &Sample| (s.at_ns - from) * pixels as i64 / width;
        for sample in &inside {
            let same = shown.iter().filter(|s| (from..=to).contains(&s.at_ns) && pixel(s) == pixel(sample));
            let (low, high) = same.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| (l.min(s.value), h.max(s.value)));
            prop_assert!(low <= sample.value && sample.value <= high);
        }
    }

    /// The same of a column that was thinned on the way: nothing beyond its extremes, over its whole length.
    #[test]
    fn a_thinned_column_keeps_the_extremes(values in proptest::collection::vec(-1e6f64..1e6, 1..3000), kept in 4usize..200) {
        let mut column = Column::holding(kept);
        for (k, value) in values.iter().enumerate() {
            column.push(k as i64, *value);
        }
        let own = column.samples().iter().map(|s| s.value);
        let of = |all: &mut dyn Iterator<Item = f64>| all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        prop_assert_eq!(of(&mut own.clone()), of(&mut values.iter().copied()));
        prop_assert!(column.samples().len() <= kept + 1);
    }
}
