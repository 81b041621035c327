use super::super::rays::Sight;
use super::*;
use crate::fixture::lshpi_rig;
use crate::scene::Surface;
use hydroline_rigs::{ImageNoise, PhysicsEntry, Slab, SlabOutline, Target};

const WIDTH: usize = 720;

fn pose(x: f64, y: f64, h: f64, phi_deg: f64, theta_deg: f64, psi_deg: f64) -> Pose6 {
    let r = f64::to_radians;
    Pose6::from([x, y, -h, r(phi_deg), r(theta_deg), r(psi_deg)])
}

fn poses() -> Vec<Pose6> {
    vec![
        pose(0.0, 0.0, 0.83, 0.0, 0.0, 0.0),
        pose(0.2, 0.01, 0.83, 1.0, -1.0, -4.0),
        pose(0.31, -0.02, 0.68, -8.0, 3.0, 7.0),
        pose(0.4, 0.0, 0.92, 0.3, -6.0, -15.0),
        pose(-0.27, 0.0, 0.7, 15.0, 0.0, 0.0),
    ]
}

/// Point samples of the model, 24 x 24 per pixel, with the first-hit routine: slow and plain.
fn brute_force(r: &Renderer, pose: &Pose6, column: usize, row: usize) -> f64 {
    let view = r.view(pose);
    let n = 24;
    let mut sum = 0.0;
    for i in 0..n * n {
        let offset = |k: usize| (k as f64 + 0.5) / n as f64 - 0.5;
        let (u, v) = (column as f64 + offset(i % n), row as f64 + offset(i / n));
        let line = view.line(&view.ray(u, v));
        let Some(hit) = r.solid.first_hit(&line).filter(|h| !h.face) else {
            continue;
        };
        let at = |f: &crate::scene::rays::Form| f.at_eye + hit.t * f.rate(u, v);
        if at(&view.fan_y).abs() <= r.optics.half_fan_rad.tan() * at(&view.fan_z) {
            sum +=
                r.optics.peak * (-0.5 * (at(&view.sheet) / r.optics.sheet_sigma_m).powi(2)).exp();
        }
    }
    sum / (n * n) as f64
}

fn sharp() -> Rig {
    let mut rig = lshpi_rig();
    rig.camera.noise = ImageNoise {
        blur_px: 0.0,
        read_sd: 0.0,
        shot_gain: 0.0,
        ambient: 0.0,
    };
    rig
}

#[test]
fn every_pixel_is_the_integral_of_the_model() {
    let r = Renderer::new(&sharp()).unwrap();
    for p in poses() {
        let clean = r.render_clean(&p);
        let (mut worst_smooth, mut worst_edge) = (0.0f64, 0.0f64);
        let near: Vec<bool> = {
            let mut near = vec![true; WIDTH];
            let truth = r.profile_truth(&p.into());
            for t in truth.iter().filter(|t| !t.near_step) {
                near[t.column_px as usize] = false;
            }
            for t in truth.iter().filter(|t| t.near_step) {
                near[t.column_px as usize] = true;
            }
            near
        };
        // A sparse, fixed set of columns, every row that either side lights.
        for column in (0..WIDTH).step_by(7) {
            for row in 0..576 {
                let ours = f64::from(clean[row * WIDTH + column]);
                let lit = ours > 0.0
                    || (1..4).any(|d| {
                        clean[(row + d).min(575) * WIDTH + column] > 0.0
                            || clean[row.saturating_sub(d) * WIDTH + column] > 0.0
                    });
                if lit {
                    let error = (ours - brute_force(&r, &p, column, row)).abs();
                    let worst = if near[column] {
                        &mut worst_edge
                    } else {
                        &mut worst_smooth
                    };
                    *worst = worst.max(error);
                }
            }
        }
        // 2 x 2 Gauss points, the 4.5 sigma cut and the brute force's own n^-2 error: 0.05 of 200 grey levels.
        assert!(
            worst_smooth < 0.05,
            "{p:?}: smooth pixels off by {worst_smooth}"
        );
        // Edges: both are samples; 1/55 and 1/24 of a pixel of 200 grey levels.
        assert!(
            worst_edge < 200.0 * (1.0 / 55.0 + 1.0 / 24.0),
            "{p:?}: edge pixels off by {worst_edge}"
        );
    }
}

/// Centre of a stripe of any shape whose truth is the row of the sheet's middle: mode of a fitted
/// Gaussian in the sheet's own coordinate, i.e. the root of sum over rows of light x distance.
#[test]
fn the_stripe_lies_on_the_analytic_line() {
    let r = Renderer::new(&sharp()).unwrap();
    let mut worst = 0.0f64;
    let mut count = 0;
    for p in poses() {
        let view = r.view(&p);
        let clean = r.render_clean(&p);
        for t in r.profile_truth(&p.into()) {
            if t.near_step || !(20.0..555.0).contains(&t.row_px) {
                continue;
            }
            let (u, height) = (
                f64::from(t.column_px),
                match t.surface {
                    Surface::Floor => 0.0,
                    Surface::Slab(0) => 0.02,
                    Surface::Slab(_) => 0.04,
                },
            );
            // Light-weighted mean of the distance to the sheet: 0 for a symmetric sheet. The pixel size on the
            // floor varies across the stripe, so each pixel weighs by d(distance)/d(row).
            let (mut moment, mut sum) = (0.0, 0.0);
            for row in t.row_px.round() as i64 - 14..=t.row_px.round() as i64 + 14 {
                let light = f64::from(clean[row as usize * WIDTH + t.column_px as usize]);
                let off = |v: f64| {
                    let s = (height - view.height.at_eye) / view.height.rate(u, v);
                    view.sheet.at_eye + s * view.sheet.rate(u, v)
                };
                let width = (off(row as f64 - 0.5) - off(row as f64 + 0.5)).abs();
                moment += light * width * off(row as f64);
                sum += light * width;
            }
            let per_row = {
                let (a, b) = (
                    view.row_of(u, height, -1e-4).unwrap().0,
                    view.row_of(u, height, 1e-4).unwrap().0,
                );
                (b - a).abs() / 2e-4
            };
            worst = worst.max((moment / sum * per_row).abs());
            count += 1;
        }
    }
    println!("{count} columns, worst centre error {worst:.6} px");
    assert!(
        count > 2000 && worst < 0.005,
        "worst centre error {worst} px over {count} columns"
    );
}

#[test]
fn same_bits_whatever_the_threads() {
    let mut rig = lshpi_rig();
    rig.camera.noise.shot_gain = 0.1;
    let r = Renderer::new(&rig).unwrap();
    let p = poses()[1];
    let with = |threads: usize| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| r.render(&p, 42))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
    assert_eq!(one, r.render(&p, 42), "again");
    assert_ne!(one, r.render(&p, 43), "another frame has other noise");
    rig.camera.seed += 1;
    assert_ne!(
        one,
        Renderer::new(&rig).unwrap().render(&p, 42),
        "another seed too"
    );
}

#[test]
fn a_frame_is_light_plus_ambient_plus_noise() {
    let rig = lshpi_rig();
    let r = Renderer::new(&rig).unwrap();
    let p = poses()[1];
    let clean = r.render_clean(&p);
    let frame = r.render(&p, 0).0;
    let residual: Vec<f64> = frame
        .iter()
        .zip(&clean)
        .map(|(g, c)| f64::from(*g) - 10.0 - f64::from(*c))
        .collect();
    let lit: Vec<f64> = residual
        .iter()
        .zip(&clean)
        .filter(|(_, c)| **c > 1.0)
        .map(|(r, _)| *r)
        .collect();
    let rms = |v: &[f64]| (v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64).sqrt();
    let expected = (4.0f64 + 1.0 / 12.0).sqrt();
    assert!(
        (rms(&residual) - expected).abs() < 0.02 && (rms(&lit) - expected).abs() < 0.06,
        "{} {}",
        rms(&residual),
        rms(&lit)
    );
}

#[test]
fn shadows_only_take_light_away_and_only_beside_steps() {
    let mut rig = sharp();
    let lit = Renderer::new(&rig).unwrap();
    rig.laser.shadows = true;
    let dark = Renderer::new(&rig).unwrap();
    // On the widening flanks of a hexagon; on the narrowing ones the camera, lower than the
    // laser, cannot see the shadow anyway.
    let p = pose(-0.02, 0.0, 0.83, 0.0, 0.0, 0.0);
    let (a, b) = (lit.render_clean(&p), dark.render_clean(&p));
    let taken: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b)).sum();
    let total: f64 = a.iter().map(|v| f64::from(*v)).sum();
    // (0.5 of 200: a pixel that became an edge is sampled by other points)
    assert!(a.iter().zip(&b).all(|(a, b)| *b <= a + 0.5));
    // Each hexagon edge at |y| = 0.084 m shades 0.084 x 0.02 / 0.79 = 2.1 mm of board: 4.3 mm of 0.6 m of stripe.
    assert!(
        (0.004..0.012).contains(&(taken / total)),
        "{}",
        taken / total
    );
    let truth = dark.profile_truth(&p.into());
    assert!(truth.len() < lit.profile_truth(&p.into()).len());
}

#[test]
fn truth_knows_steps_fans_and_hidden_columns() {
    let r = Renderer::new(&lshpi_rig()).unwrap();
    // Sheet at X = 0.27 + 0.0: second hexagon, near its widest.
    let p = pose(0.04, 0.0, 0.83, 0.0, 0.0, 0.0);
    let truth = r.profile_truth(&p.into());
    let on = |s: Surface| truth.iter().filter(|t| t.surface == s).collect::<Vec<_>>();
    let (floor, board, hexagon) = (
        on(Surface::Floor),
        on(Surface::Slab(0)),
        on(Surface::Slab(1)),
    );
    assert!(floor.len() > 200 && board.len() > 30 && hexagon.len() > 200);
    // Widths across: 0.30 m board between +-0.15, hexagon inside +-0.12; rows rise with height.
    assert!(
        board
            .iter()
            .all(|t| t.xi_m.abs() <= 0.15 && t.xi_m.abs() > 0.10)
    );
    assert!(
        hexagon
            .iter()
            .all(|t| t.xi_m.abs() <= 0.12 && (t.eta_m - (0.68 - 0.83 + 0.04)).abs() < 1e-12)
    );
    assert!(hexagon[0].row_px < board[0].row_px && board[0].row_px < floor[0].row_px);
    // Fan: |xi| <= tan(20 deg) * 0.83 = 0.302 m.
    assert!(
        floor
            .iter()
            .all(|t| t.xi_m.abs() <= 0.83 * 20f64.to_radians().tan())
    );
    assert!(
        truth
            .iter()
            .all(|t| t.near_step || t.step_distance_px >= crate::scene::NEAR_STEP_PX)
    );
    let middle = hexagon.iter().find(|t| t.column_px == 360).unwrap();
    assert!(
        !middle.near_step && middle.step_distance_px > 80.0,
        "{middle:?}"
    );
    let edge = board.iter().find(|t| t.step_distance_px < 1.0).unwrap();
    assert!(edge.near_step);
    // A stripe across the board's front edge: half of its thickness on the floor, nowhere a clean middle there.
    let at_edge = r.profile_truth(&pose(-0.2695, 0.0, 0.83, 0.0, 0.0, 0.0).into());
    assert!(
        at_edge
            .iter()
            .filter(|t| t.xi_m.abs() < 0.14)
            .all(|t| t.near_step)
    );
}

#[test]
fn polygons_and_rotated_targets_render_like_what_they_are() {
    let mut rig = sharp();
    let square = |outline| Slab {
        name: "s".into(),
        outline,
        top_m: 0.03,
        albedo: 0.5,
    };
    let target = |outline, origin| {
        Some(Target {
            name: "t".into(),
            slabs: vec![square(outline)],
            origin,
        })
    };
    rig.target = target(
        SlabOutline::Rectangle {
            x0_m: 0.1,
            x1_m: 0.6,
            width_m: 0.2,
        },
        [0.0; 3],
    );
    let p = pose(0.05, 0.01, 0.8, 2.0, 1.0, 3.0);
    let as_rectangle = Renderer::new(&rig).unwrap().render_clean(&p);
    rig.target = target(
        SlabOutline::Polygon {
            points_m: vec![[0.1, -0.1], [0.6, -0.1], [0.6, 0.1], [0.1, 0.1]],
        },
        [0.0; 3],
    );
    assert_eq!(as_rectangle, Renderer::new(&rig).unwrap().render_clean(&p));
    // The same place described by a rotated, shifted target frame.
    rig.target = target(
        SlabOutline::Polygon {
            points_m: vec![[-0.1, 0.0], [0.1, 0.0], [0.1, -0.5], [-0.1, -0.5]],
        },
        [0.1, 0.0, std::f64::consts::FRAC_PI_2],
    );
    let turned = Renderer::new(&rig).unwrap().render_clean(&p);
    let worst = as_rectangle
        .iter()
        .zip(&turned)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn extreme_poses_and_bad_rigs_are_harmless() {
    let r = Renderer::new(&lshpi_rig()).unwrap();
    for p in [
        pose(0.0, 0.0, 0.83, 0.0, 60.0, 0.0),
        pose(0.0, 0.0, 0.83, 90.0, 0.0, 0.0),
        pose(0.0, 0.0, 0.83, 180.0, 0.0, 0.0),
        pose(0.0, 0.0, -1.0, 0.0, 0.0, 0.0),
        pose(0.3, 0.0, 0.21, 0.0, 0.0, 0.0),
        pose(1e9, 0.0, 0.83, 0.0, 0.0, 0.0),
        Pose6::from([f64::NAN; 6]),
        Pose6::from([f64::INFINITY; 6]),
    ] {
        assert_eq!(r.render(&p, 1).0.len(), 720 * 576, "{p:?}");
        assert!(
            r.profile_truth(&p.into())
                .iter()
                .all(|t| t.row_px.is_finite())
        );
    }
    let mut rig = lshpi_rig();
    rig.laser.sigma_m = 0.0;
    assert!(matches!(
        Renderer::new(&rig),
        Err(SceneError::Range {
            what: "laser.sigma_m",
            ..
        })
    ));
    rig = lshpi_rig();
    rig.camera.fx_px = f64::NAN;
    assert!(matches!(
        Renderer::new(&rig),
        Err(SceneError::Range {
            what: "camera.fx_px",
            ..
        })
    ));
    rig = lshpi_rig();
    rig.physics.push(PhysicsEntry {
        effect: "nonsense".into(),
        parameters: Vec::new(),
    });
    assert!(matches!(Renderer::new(&rig), Err(SceneError::Effect(_))));
}

/// Edges that meet every pixel alike: what one pixel is off by, the whole edge is.
#[test]
fn an_edge_along_columns_rows_or_diagonals_is_seen_to_a_fortieth_of_a_pixel() {
    for (nx, ny) in [
        (1.0, 0.0),
        (0.0, 1.0),
        (1.0, 1.0),
        (1.0, -1.0),
        (1.0, 2.0),
        (2.0, -1.0),
    ] {
        let length = f64::hypot(nx, ny);
        let (nx, ny) = (nx / length, ny / length);
        for k in 0..200 {
            let offset = (f64::from(k) / 200.0 - 0.5) * (nx.abs() + ny.abs());
            let shade = |u: f64, v: f64| (Code(0), f64::from(u8::from(nx * u + ny * v < offset)));
            let seen = f64::from(lattice(&shade, 0.0, 0.0));
            // Area of the unit square below the line, column by column.
            let columns = 4000;
            let below: f64 = (0..columns)
                .map(|i| {
                    let u = (f64::from(i) + 0.5) / f64::from(columns) - 0.5;
                    if ny == 0.0 {
                        return f64::from(u8::from(nx * u < offset));
                    }
                    let v = (offset - nx * u) / ny;
                    let share = (v + 0.5).clamp(0.0, 1.0);
                    if ny > 0.0 { share } else { 1.0 - share }
                })
                .sum();
            let exact = below / f64::from(columns);
            assert!(
                (seen - exact).abs() < 0.025,
                "({nx}, {ny}) {offset}: {seen} {exact}"
            );
        }
    }
}

/// FNV-1a of grey levels.
fn fingerprint(frames: &[GreyPixels]) -> u64 {
    let bytes = frames.iter().flat_map(|f| &f.0);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Frames of tank and board under noise, haze, speckle and saturation were these before light and camera had laws of their own.
#[test]
fn without_laws_of_light_and_camera_frames_are_what_they_were() {
    let mut rig = lshpi_rig();
    rig.camera.noise.ambient = 12.0;
    rig.camera.noise.shot_gain = 0.05;
    let plain = Renderer::new(&rig).unwrap();
    let number = |name: &str, value| {
        (
            name.to_owned(),
            hydroline_rigs::ParameterValue::Number(value),
        )
    };
    let of = |effect: &str, parameters: &[(&str, f64)]| PhysicsEntry {
        effect: effect.to_owned(),
        parameters: parameters.iter().map(|(n, v)| number(n, *v)).collect(),
    };
    rig.physics = vec![
        of(
            "backscatter_haze",
            &[("fraction", 0.05), ("length_m", 0.01)],
        ),
        of("speckle", &[("contrast", 0.2), ("grain_px", 1.5)]),
        of("image_saturation", &[("level_grey", 180.0)]),
        of("attenuation", &[("c_pm", 0.3)]),
    ];
    let murky = Renderer::new(&rig).unwrap();
    let board = rig.board.clone().unwrap();
    let placement = crate::scene::BoardPlacement::default();
    let light = crate::scene::BoardLight {
        room: 150.0,
        slope_per_m: [0.3, 0.3],
        laser: true,
        grazing: 0.1,
    };
    let mut frames: Vec<GreyPixels> = Vec::new();
    for (k, pose) in poses().iter().enumerate() {
        frames.push(plain.render(pose, k as u64));
        frames.push(murky.render(pose, k as u64));
    }
    frames.push(plain.render_board(&board, &placement, &light, 3).unwrap());
    assert_eq!(fingerprint(&frames), 856_763_892_413_935_493);
}
