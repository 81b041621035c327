//! Accuracy on synthetic stripes against the Cramér-Rao bound. A share of the table runs with
//! every test run; the whole of it with
//! `cargo test -p hydroline --lib stripe::accuracy -- --ignored --nocapture`.

use crate::synthetic::{StripeImage, render, row_bound_px};
use crate::{Extractor, ExtractorConfig, Profile, quality};

/// Error statistics over all points of some frames.
#[derive(Debug, Default, Clone, Copy)]
struct Errors {
    count: f64,
    sum: f64,
    square: f64,
    worst: f64,
    over_bound: f64,
    over_sd: f64,
    columns: f64,
}

impl Errors {
    fn add(&mut self, stripe: &StripeImage, profile: &Profile) {
        self.columns += stripe.width_px as f64;
        for p in &profile.points {
            let truth = stripe.row_px(p.column_px);
            let error = p.row_px - truth;
            let bound = row_bound_px(stripe.sigma_px, stripe.peak, stripe.noise_sd, truth);
            self.count += 1.0;
            self.sum += error;
            self.square += error * error;
            self.worst = self.worst.max(error.abs());
            self.over_bound += (error / bound).powi(2);
            self.over_sd += (error / p.sd_px).powi(2);
        }
    }

    fn merge(mut self, o: Errors) -> Errors {
        self.count += o.count;
        self.sum += o.sum;
        self.square += o.square;
        self.worst = self.worst.max(o.worst);
        self.over_bound += o.over_bound;
        self.over_sd += o.over_sd;
        self.columns += o.columns;
        self
    }

    fn bias(&self) -> f64 {
        self.sum / self.count
    }

    fn rms(&self) -> f64 {
        (self.square / self.count).sqrt()
    }

    /// rms of error / Cramér-Rao bound.
    fn efficiency(&self) -> f64 {
        (self.over_bound / self.count).sqrt()
    }

    /// rms of error / reported sd.
    fn honesty(&self) -> f64 {
        (self.over_sd / self.count).sqrt()
    }

    fn coverage(&self) -> f64 {
        self.count / self.columns
    }
}

fn measure(base: &StripeImage, frames: u64) -> Errors {
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let mut errors = Errors::default();
    for seed in 0..frames {
        let slope = [0.0137, -0.291, 0.364, 0.0][seed as usize % 4];
        let row0_px = if slope < -0.1 { 400.0 } else { 150.0 } + 0.37 * seed as f64;
        let stripe = StripeImage {
            slope,
            row0_px,
            seed: base.seed + seed,
            ..base.clone()
        };
        errors.add(&stripe, &extractor.extract(&render(&stripe)));
    }
    errors
}

fn print(name: &str, e: &Errors) {
    println!(
        "{name:44} {:6.3} {:7.3} {:8.4} {:7.4} {:6.3} {:6.3} {:6.3}",
        e.coverage(),
        e.efficiency(),
        e.bias(),
        e.rms(),
        e.worst,
        e.honesty(),
        e.count / 1000.0
    );
}

fn header() {
    println!(
        "{:44} {:>6} {:>7} {:>8} {:>7} {:>6} {:>6} {:>6}",
        "", "cover", "rms/CRB", "bias", "rms px", "worst", "err/sd", "k pts"
    );
}

/// Runs a table of stripes, prints it, and collects every limit missed: the whole table is
/// seen, not only its first bad line.
fn table(
    stripes: impl Iterator<Item = StripeImage>,
    frames: u64,
    limits: impl Fn(&Errors) -> Vec<String>,
) {
    header();
    let mut misses = Vec::new();
    let mut all = Errors::default();
    for s in stripes {
        let e = measure(&s, frames);
        let haze = if s.haze_fraction > 0.0 {
            format!("haze {}/{}", s.haze_fraction, s.haze_length_px)
        } else {
            String::new()
        };
        let name = format!(
            "sigma {} peak {} noise {} {haze}",
            s.sigma_px, s.peak, s.noise_sd
        );
        print(&name, &e);
        if e.coverage() < 0.999 {
            misses.push(format!("{name}: coverage {}", e.coverage()));
        }
        misses.extend(limits(&e).into_iter().map(|m| format!("{name}: {m}")));
        all = all.merge(e);
    }
    print("all", &all);
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}

fn stripes(sigmas: &[f64], peaks: &[f64], noises: &[f64]) -> Vec<StripeImage> {
    let mut out = Vec::new();
    for &sigma_px in sigmas {
        for &peak in peaks {
            for &noise_sd in noises {
                out.push(StripeImage {
                    sigma_px,
                    peak,
                    noise_sd,
                    ..Default::default()
                });
            }
        }
    }
    out
}

fn hazy(clear: Vec<StripeImage>, fractions: &[f64], lengths: &[f64]) -> Vec<StripeImage> {
    let with = |s: &StripeImage, haze_fraction, haze_length_px| StripeImage {
        haze_fraction,
        haze_length_px,
        ..s.clone()
    };
    clear
        .iter()
        .flat_map(|s| {
            fractions
                .iter()
                .flat_map(move |f| lengths.iter().map(move |l| with(s, *f, *l)))
        })
        .collect()
}

/// Statistical margin of an rms over N points: 3 / sqrt(2 N).
fn margin(e: &Errors) -> f64 {
    1.0 + 3.0 / (2.0 * e.count).sqrt()
}

fn at_bound(e: &Errors) -> Vec<String> {
    let mut out = Vec::new();
    if e.efficiency() > 1.1 * margin(e) {
        out.push(format!("{} x the bound", e.efficiency()));
    }
    if !(0.9 / margin(e)..=1.1 * margin(e)).contains(&e.honesty()) {
        out.push(format!("error/sd {}", e.honesty()));
    }
    out
}

fn bias_below(limit: f64) -> impl Fn(&Errors) -> Vec<String> {
    move |e| {
        let mut out = Vec::new();
        if e.bias().abs() >= limit {
            out.push(format!("bias {}", e.bias()));
        }
        if !(0.9 / margin(e)..=1.1 * margin(e)).contains(&e.honesty()) {
            out.push(format!("error/sd {}", e.honesty()));
        }
        out
    }
}

/// Peaks beyond 255 by these factors.
fn clipped(sigmas: &[f64], gains: &[f64], noises: &[f64]) -> Vec<StripeImage> {
    let peaks: Vec<f64> = gains.iter().map(|g| 255.0 * g).collect();
    stripes(sigmas, &peaks, noises)
}

#[test]
fn reaches_the_bound_with_an_honest_sd() {
    table(
        stripes(&[1.0, 3.0], &[60.0, 200.0], &[4.0]).into_iter(),
        2,
        at_bound,
    );
}

#[test]
#[ignore = "the whole table"]
fn reaches_the_bound_whole_table() {
    let all = stripes(
        &[1.0, 1.25, 1.5, 2.0, 2.5, 3.0],
        &[60.0, 90.0, 130.0, 200.0],
        &[2.0, 3.0, 4.0],
    );
    table(all.into_iter(), 8, at_bound);
}

#[test]
fn saturation_does_not_bias() {
    table(
        clipped(&[1.0, 2.0], &[1.5, 3.0], &[3.0]).into_iter(),
        2,
        bias_below(0.02),
    );
}

#[test]
#[ignore = "the whole table"]
fn saturation_whole_table() {
    let all = clipped(
        &[1.0, 1.5, 2.0, 3.0],
        &[0.95, 1.1, 1.5, 2.0, 3.0],
        &[2.0, 4.0],
    );
    table(all.into_iter(), 4, bias_below(0.02));
}

#[test]
fn haze_does_not_bias() {
    let all = hazy(
        stripes(&[2.0], &[150.0], &[3.0]),
        &[0.02, 0.05],
        &[80.0, -40.0],
    );
    table(all.into_iter(), 2, bias_below(0.05));
}

#[test]
#[ignore = "the whole table"]
fn haze_whole_table() {
    let all = stripes(&[1.0, 2.0, 3.0], &[60.0, 200.0], &[2.0, 4.0]);
    table(
        hazy(all, &[0.02, 0.05], &[20.0, 80.0, 200.0, -80.0]).into_iter(),
        4,
        bias_below(0.05),
    );
}

/// Clipped three times over AND hazy: the row stays unbiased, its sd is up to twice too small and
/// a narrow stripe (sigma 1 px) loses one column in eight.
#[test]
#[ignore = "beyond what is asked; shows the limit"]
fn haze_and_saturation_together() {
    header();
    for s in hazy(
        clipped(&[1.0, 2.0, 3.0], &[1.5, 3.0], &[3.0]),
        &[0.05],
        &[80.0],
    ) {
        let e = measure(&s, 4);
        print(
            &format!(
                "sigma {} peak {} noise {} hazy",
                s.sigma_px, s.peak, s.noise_sd
            ),
            &e,
        );
        assert!(e.bias().abs() < 0.05 && e.coverage() > 0.8, "{s:?}");
    }
}

#[test]
fn quality_bits_say_what_was_done() {
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let mut of = |stripe: StripeImage| extractor.extract(&render(&stripe)).points[200].quality;
    assert_eq!(of(StripeImage::default()), 0);
    assert_eq!(
        of(StripeImage {
            peak: 500.0,
            ..Default::default()
        }),
        quality::SATURATED
    );
    assert_eq!(
        of(StripeImage {
            haze_fraction: 0.05,
            ..Default::default()
        }),
        quality::HAZE_CORRECTED
    );
}

#[test]
fn bound_matches_the_textbook_for_wide_stripes() {
    // (n/A) sqrt(2 s / sqrt(pi)); the pixel's own 1/12 px² raises it a little.
    let textbook =
        (16.0f64 + 1.0 / 12.0).sqrt() / 60.0 * (2.0 * 3.0 / std::f64::consts::PI.sqrt()).sqrt();
    let ratio = row_bound_px(3.0, 60.0, 4.0, 0.2) / textbook;
    assert!((1.0..1.02).contains(&ratio), "{ratio}");
}

#[test]
fn the_frame_depends_on_the_seed_alone() {
    let a = StripeImage {
        width_px: 30,
        height_px: 20,
        ..Default::default()
    };
    assert_eq!(render(&a), render(&a));
    assert_ne!(
        render(&a),
        render(&StripeImage {
            seed: 1,
            ..a.clone()
        })
    );
}
