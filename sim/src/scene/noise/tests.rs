use super::*;

fn camera(read_sd: f64, shot_gain: f64, ambient: f64) -> Noise {
    Noise::new(
        &ImageNoise {
            blur_px: 0.0,
            read_sd,
            shot_gain,
            ambient,
        },
        7,
        255.0,
    )
}

fn dark(noise: &Noise, frame: u64) -> Vec<f64> {
    let mut pixels = vec![0u8; 720 * 576];
    for (row, line) in pixels.chunks_mut(720).enumerate() {
        noise.dark_row(frame, row, line);
    }
    pixels.into_iter().map(f64::from).collect()
}

/// Mean, variance, skewness, kurtosis.
fn moments(v: &[f64]) -> [f64; 4] {
    let n = v.len() as f64;
    let mean = v.iter().sum::<f64>() / n;
    let central = |k: i32| v.iter().map(|x| (x - mean).powi(k)).sum::<f64>() / n;
    let var = central(2);
    [
        mean,
        var,
        central(3) / var.powf(1.5),
        central(4) / var.powi(2),
    ]
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let ([ma, va, ..], [mb, vb, ..]) = (moments(a), moments(b));
    a.iter()
        .zip(b)
        .map(|(x, y)| (x - ma) * (y - mb))
        .sum::<f64>()
        / a.len() as f64
        / (va * vb).sqrt()
}

#[test]
fn the_table_is_normal() {
    let table: Vec<f64> = NORMAL.iter().map(|&v| f64::from(v)).collect();
    let [mean, var, skew, kurtosis] = moments(&table);
    assert!(
        mean.abs() < 1e-7 && (var - 1.0).abs() < 1e-6 && skew.abs() < 1e-6,
        "{mean} {var} {skew}"
    );
    assert!((2.997..3.0).contains(&kurtosis), "{kurtosis}");
    assert!(
        (4.0..4.6).contains(&table[SAMPLES - 1]),
        "{}",
        table[SAMPLES - 1]
    );
    // Known quantiles: Phi(1.959964) = 0.975, Phi(0.674490) = 0.75 (cell middles are half a cell off).
    assert!((table[(SAMPLES as f64 * 0.975) as usize] - 1.959_964).abs() < 3e-4);
    assert!((table[SAMPLES * 3 / 4] - 0.674_490).abs() < 1e-4);
}

#[test]
fn dark_pixels_have_the_asked_moments() {
    for read_sd in [1.5, 2.0, 4.0] {
        let v = dark(&camera(read_sd, 0.0, 40.0), 3);
        let [mean, var, skew, kurtosis] = moments(&v);
        let n = v.len() as f64;
        let expected = read_sd * read_sd + 1.0 / 12.0; // rounding to whole grey levels
        println!(
            "sd {read_sd}: mean {mean:.4} variance {var:.4} (asked {expected:.4}) skew {skew:.4} kurtosis {kurtosis:.4}"
        );
        // Five standard errors of each moment.
        assert!(
            (mean - 40.0).abs() < 5.0 * (expected / n).sqrt(),
            "mean {mean}"
        );
        assert!(
            (var / expected - 1.0).abs() < 5.0 * (2.0 / n).sqrt(),
            "variance {var}, {expected}"
        );
        assert!(skew.abs() < 5.0 * (6.0 / n).sqrt(), "skew {skew}");
        // Rounding takes 1.2 (q/sd)^4 / 12^2.. off the kurtosis, far below this.
        assert!(
            (kurtosis - 3.0).abs() < 5.0 * (24.0 / n).sqrt() + 0.005,
            "kurtosis {kurtosis}"
        );
    }
}

#[test]
fn frames_seeds_rows_and_neighbours_are_independent() {
    let noise = camera(3.0, 0.0, 40.0);
    let (a, b) = (dark(&noise, 10), dark(&noise, 11));
    let other = Noise::new(
        &ImageNoise {
            blur_px: 0.0,
            read_sd: 3.0,
            shot_gain: 0.0,
            ambient: 40.0,
        },
        8,
        255.0,
    );
    let limit = 5.0 / (a.len() as f64).sqrt();
    let pairs = [
        ("next frame", correlation(&a, &b)),
        ("other seed", correlation(&a, &dark(&other, 10))),
        ("neighbour", correlation(&a[1..], &a[..a.len() - 1])),
        ("pixel after next", correlation(&a[2..], &a[..a.len() - 2])),
        ("third neighbour", correlation(&a[3..], &a[..a.len() - 3])),
        ("next group", correlation(&a[4..], &a[..a.len() - 4])),
        ("next row", correlation(&a[720..], &a[..a.len() - 720])),
    ];
    for (what, r) in pairs {
        assert!(
            r.abs() < limit,
            "{what}: correlation {r:.5}, limit {limit:.5}"
        );
    }
    // Squares too: a shared scale would show there.
    let square = |v: &[f64]| v.iter().map(|x| (x - 40.0).powi(2)).collect::<Vec<_>>();
    assert!(correlation(&square(&a), &square(&b)).abs() < limit);
}

#[test]
fn the_fast_path_is_the_slow_path() {
    let noise = camera(2.0, 0.5, 10.0);
    let mut line = vec![0u8; 723];
    noise.dark_row(5, 17, &mut line);
    for (column, &fast) in line.iter().enumerate() {
        assert_eq!(
            noise.pixel(5, 17, column, 723, 0.0),
            fast,
            "column {column}"
        );
    }
}

#[test]
fn shot_noise_grows_with_the_light_and_255_is_the_end() {
    let noise = camera(2.0, 0.25, 10.0);
    let v: Vec<f64> = (0..200_000)
        .map(|i| f64::from(noise.pixel(0, i / 500, i % 500, 500, 90.0)))
        .collect();
    let [mean, var, ..] = moments(&v);
    let expected = 4.0 + 0.25 * 100.0 + 1.0 / 12.0;
    assert!(
        (mean - 100.0).abs() < 0.06 && (var / expected - 1.0).abs() < 0.02,
        "{mean} {var}"
    );
    assert_eq!(noise.pixel(0, 0, 0, 500, 400.0), 255);
    let clipped = Noise::new(
        &ImageNoise {
            blur_px: 0.0,
            read_sd: 2.0,
            shot_gain: 0.0,
            ambient: 10.0,
        },
        7,
        180.0,
    );
    assert_eq!(clipped.pixel(0, 0, 0, 500, 400.0), 180);
}
