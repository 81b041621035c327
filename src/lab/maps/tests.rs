use super::*;
use hydroline_calib::map::{RefractivePrior, refractive::Known};

fn of(method: Method, case: Case) -> Row {
    row(method, case, 7, 4000).unwrap()
}

/// The measured values of the project's notes, section 1.4: our own port of the literal
/// maps must land on them, or it is another map.
#[test]
fn literal_maps_have_the_known_scallop() {
    for (method, case, rms_xi, rms_eta, max) in [
        (Method::Affine, Case::PortExact, 0.228, 0.498, 0.97),
        (Method::Bilinear, Case::PortExact, 0.051, 0.498, 0.97),
        (Method::Graticule, Case::PortExact, 0.045, 0.492, 0.91),
        (Method::Graticule, Case::AirExact, 0.0, 0.493, 0.85),
    ] {
        let r = of(method, case);
        assert!((r.rms_xi_mm - rms_xi).abs() < 0.01, "{r:?}");
        assert!((r.rms_eta_mm - rms_eta).abs() < 0.01, "{r:?}");
        assert!((r.max_mm - max).abs() < 0.02, "{r:?}");
        // One sign: the mean is nearly the rms.
        assert!(r.mean_eta_mm.abs() > 0.85 * r.rms_eta_mm, "{r:?}");
    }
}

#[test]
fn better_maps_meet_their_limits() {
    let exact = of(Method::Homography, Case::PortExact);
    assert!(exact.max_mm <= 0.05, "{exact:?}");
    let noisy = of(Method::Homography, Case::PortNoisy);
    assert!(noisy.max_mm <= 0.2, "{noisy:?}");
    let rectified = of(Method::RectifiedGraticule, Case::PortExact);
    assert!(
        rectified.rms_xi_mm <= 0.05 && rectified.rms_eta_mm <= 0.05,
        "{rectified:?}"
    );
    // The refractive map is the right model: two independent ways through Snell's law.
    let refractive = of(Method::Refractive, Case::PortExact);
    assert!(refractive.max_mm < 1e-3, "{refractive:?}");
}

/// A map fitted in fresh water and used in the sea: the refractive map gets the new
/// index, homography cannot be.
#[test]
fn refractive_survives_a_change_of_water() {
    let fresh = Rig::behind_port();
    let sea = Rig {
        n_water: 1.340,
        ..fresh
    };
    let mut rng = StdRng::seed_from_u64(3);
    let nodes = nodes(&fresh, 0.0, &mut rng);
    let options = FitOptions {
        image: Some(fresh.image()),
        refractive: Some(RefractivePrior {
            port_distance_m: Known::new(0.030, 0.0005),
            n_water: Known::new(1.333, 0.0002),
            ..prior(&fresh)
        }),
    };
    let hydroline_calib::map::FittedMap::Refractive(map) =
        fit(Method::Refractive, &nodes, &options).unwrap()
    else {
        panic!("not refractive");
    };
    let homography = fit(Method::Homography, &nodes, &options).unwrap();
    let moved = map.in_water(Known::new(1.340, 0.0002));
    let (mut worst, mut worst_old) = (0.0f64, 0.0f64);
    for k in 0..400 {
        let (xi, eta) = (
            -0.2 + 0.02 * f64::from(k % 20),
            -0.24 + 0.02 * f64::from(k / 20),
        );
        let p = sea.project(xi, eta, 0.0).unwrap();
        if let (Some(a), Some(b)) = (moved.to_plane(p[0], p[1]), homography.to_plane(p[0], p[1])) {
            worst = worst.max((a.xi_m - xi).hypot(a.eta_m - eta));
            worst_old = worst_old.max((b.xi_m - xi).hypot(b.eta_m - eta));
        }
    }
    assert!(worst_old > 1e-3, "the case must matter: {worst_old}");
    assert!(worst < 0.1 * worst_old, "{worst} m against {worst_old} m");
}

/// The same with what a person knows: a port by the ruler to a third, water by a table. The index the
/// fit settled on may be off, lens and port with it; the reported sd must say so.
#[test]
fn refractive_in_other_water_knows_what_it_does_not_know() {
    let fresh = Rig::behind_port();
    let sea = Rig {
        n_water: 1.340,
        ..fresh
    };
    let (mut worst_sd, mut rms) = (0.0f64, 0.0);
    const RUNS: u64 = 12;
    for seed in 0..RUNS {
        let mut rng = StdRng::seed_from_u64(seed);
        let nodes = nodes(&fresh, 0.2, &mut rng);
        // Off by one sd, to either side in turn.
        let off = if seed % 2 == 0 { 1.0 } else { -1.0 };
        let options = FitOptions {
            image: Some(fresh.image()),
            refractive: Some(RefractivePrior {
                port_distance_m: Known::new(0.030 + 0.009 * off, 0.009),
                n_water: Known::new(1.333 - 0.0015 * off, 0.0015),
                ..prior(&fresh)
            }),
        };
        let hydroline_calib::map::FittedMap::Refractive(map) =
            fit(Method::Refractive, &nodes, &options).unwrap()
        else {
            panic!("not refractive");
        };
        let moved = map.in_water(Known::new(1.340 + 0.002 * off, 0.002));
        let mut count = 0.0;
        let mut sum = 0.0;
        for k in 0..100 {
            let (xi, eta) = (
                -0.2 + 0.04 * f64::from(k % 10),
                -0.24 + 0.04 * f64::from(k / 10),
            );
            let p = sea.project(xi, eta, 0.0).unwrap();
            if let Some(a) = moved.to_plane(p[0], p[1]) {
                let e = nalgebra::Vector2::new(a.xi_m - xi, a.eta_m - eta);
                let sds = e.dot(&(a.covariance_m2.try_inverse().unwrap() * e)).sqrt();
                worst_sd = worst_sd.max(sds);
                sum += e.norm_squared();
                count += 1.0;
            }
        }
        rms += sum / count / RUNS as f64;
    }
    println!("rms {:.3} mm, at most {worst_sd:.1} sd", 1e3 * rms.sqrt());
    // Everything is off by one sd at once: four of them add up to two.
    assert!(worst_sd < 3.5, "{worst_sd}");
    // Homography costs 1 mm rms and 2 mm at most; this one must not be worse.
    assert!(rms.sqrt() < 1e-3, "{}", rms.sqrt());
}

/// No map answers outside its nodes, and every answer inside goes back to its pixel.
#[test]
fn maps_refuse_to_extrapolate_and_invert_themselves() {
    let rig = Rig::behind_port();
    let mut rng = StdRng::seed_from_u64(5);
    let nodes = nodes(&rig, 0.1, &mut rng);
    let options = FitOptions {
        image: Some(rig.image()),
        refractive: Some(prior(&rig)),
    };
    for &method in Method::ALL {
        let map = fit(method, &nodes, &options).unwrap();
        for (xi, eta) in [(0.26, 0.0), (-0.27, -0.1), (0.0, 0.22), (0.1, -0.30)] {
            let p = rig.project(xi, eta, 0.0).unwrap();
            assert_eq!(map.to_plane(p[0], p[1]), None, "{method:?} at {xi} {eta}");
            assert_eq!(map.to_image(xi, eta), None);
        }
        assert_eq!(map.to_plane(f64::NAN, 0.0), None);
        for k in 0..60 {
            let (xi, eta) = (
                -0.24 + 0.05 * f64::from(k % 10),
                -0.27 + 0.08 * f64::from(k / 10),
            );
            let (column, row) = map.to_image(xi, eta).unwrap();
            let back = map.to_plane(column, row).unwrap();
            let off = (back.xi_m - xi).hypot(back.eta_m - eta);
            // The affine cells do not meet at their borders: they overlap by their misfit.
            let limit = if method == Method::Affine {
                1.5e-3
            } else {
                1e-8
            };
            assert!(off < limit, "{method:?} at {xi} {eta}: {off}");
            let j = map.jacobian(column, row).unwrap();
            let c = back.covariance_m2;
            assert!(j.determinant().abs() > 0.0 && c[(0, 0)] > 0.0 && c[(1, 1)] > 0.0);
        }
    }
}

fn coverage(calibrations: u64) -> (f64, usize) {
    let mut held = 0.0;
    let mut asked = 0;
    for seed in 0..calibrations {
        let r = row(Method::Homography, Case::PortNoisy, 1000 + seed, 60).unwrap();
        held += r.covered * r.answered as f64;
        asked += r.answered;
    }
    (held / asked as f64, asked)
}

/// A share of the full test: coverage of one calibration varies by about 0.06 (its points
/// share one fit), so the mean of 60 by 0.008; three of those around 92–98 %.
#[test]
fn intervals_cover_the_truth() {
    let (covered, _) = coverage(60);
    assert!(
        (0.92 - 0.024..=0.98 + 0.015).contains(&covered),
        "{covered}"
    );
}

#[test]
#[ignore = "500 calibrations; run with --ignored"]
fn intervals_cover_the_truth_in_full() {
    let (covered, asked) = coverage(500);
    println!(
        "95 % intervals of 500 calibrations hold {:.2} % of {asked} test points",
        100.0 * covered
    );
    assert!((0.92..=0.98).contains(&covered), "{covered}");
}

/// The largest error over the sheet is the luck of 242 numbers: perspective alone, which nobody
/// can do without, stays within 0.2 mm for 93 % of all boards; the lens and its port may cost little more.
#[test]
fn distortion_costs_little_more_than_perspective_alone() {
    let least = spread::perspective_alone(100, 1000).unwrap();
    assert!((0.08..0.13).contains(&least.median_mm), "{least:?}");
    for (case, within) in [(Case::PortNoisy, 0.75), (Case::AirNoisy, 0.85)] {
        let found = spread::over_seeds(Method::Homography, case, 100, 1000).unwrap();
        assert!(found.median_mm < 1.45 * least.median_mm, "{found:?}");
        assert!(found.within >= within, "{case:?}: {found:?}");
    }
}
