//! Boards computed, not rendered: what is refused, and with which sentence.

use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};

use super::camera::{CAMERA, FOCAL, Lens};
use super::*;

const SD_PX: f64 = 0.05;

struct World {
    lens: Lens,
    normal: Vector3<f64>,
    offset_m: f64,
}

fn world() -> World {
    let mut numbers = [0.0; CAMERA];
    numbers[..5].copy_from_slice(&[750.0, 1.0, 355.0, 292.0, -0.12]);
    numbers[MEDIUM] = 1.0003;
    let normal = Vector3::new(0.03, 0.7, 0.72).normalize();
    World {
        lens: Lens {
            numbers,
            plate: None,
        },
        normal,
        offset_m: 0.6 * normal[2],
    }
}

fn image() -> ImageSize {
    ImageSize {
        width_px: 720,
        height_px: 576,
    }
}

fn options() -> FreeOptions {
    FreeOptions::new(
        image(),
        CameraPrior::unknown(image(), Known::new(1.0003, 0.0003)),
    )
}

/// Board with its middle on the sheet where the ray (u, v, 1) meets it.
fn pose(world: &World, [u, v]: [f64; 2], [x, y]: [f64; 2]) -> Pose {
    let along = Vector3::new(u, v, 1.0);
    let facing = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
    Pose {
        rotation: Rotation3::from_euler_angles(x, y, 0.1).matrix() * facing,
        translation: along * (world.offset_m / world.normal.dot(&along)),
    }
}

fn see(world: &World, pose: &Pose, k: u64, shear_px: f64) -> Seen {
    let mut rng = StdRng::seed_from_u64(k);
    let noise = Normal::new(0.0, SD_PX).unwrap();
    let mut nodes = Vec::new();
    for j in -3..=3 {
        for i in -4..=4 {
            let board_m = [0.025 * f64::from(i), 0.025 * f64::from(j)];
            let p = world.lens.project(&pose.at(board_m)).unwrap();
            let shift = shear_px * f64::from(j) / 6.0;
            nodes.push(SeenNode {
                board_m,
                pixel: [
                    p[0] + shift + noise.sample(&mut rng),
                    p[1] + noise.sample(&mut rng),
                ],
                covariance_px2: Matrix2::identity() * SD_PX * SD_PX,
            });
        }
    }
    let board_normal: Vector3<f64> = pose.rotation.column(2).into();
    let along = board_normal.cross(&world.normal).normalize();
    let line = (-12..=12).map(|k| {
        let at = pose.translation + along * (0.007 * f64::from(k));
        let p = world.lens.project(&at).unwrap();
        let ahead = world.lens.project(&(at + along * 1e-4)).unwrap() - p;
        let across = Vector2::new(-ahead[1], ahead[0]).normalize();
        let seen = p + across * noise.sample(&mut rng);
        LinePoint {
            pixel: seen.into(),
            across: across.into(),
            sd_px: SD_PX,
        }
    });
    Seen {
        name: format!("image {k}"),
        nodes,
        line: line.collect(),
        no_line: None,
        blur_px: 0.7,
    }
}

fn session(seed: u64) -> (World, Vec<Pose>) {
    let world = world();
    let mut rng = StdRng::seed_from_u64(seed);
    let mut any = |r: f64| rng.random_range(-r..r);
    let poses = (0..12)
        .map(|_| pose(&world, [any(0.25), any(0.2)], [any(0.6), any(0.6)]))
        .collect();
    (world, poses)
}

fn views(world: &World, poses: &[Pose]) -> Vec<Seen> {
    (0..)
        .zip(poses)
        .map(|(k, p)| see(world, p, k, 0.0))
        .collect()
}

#[test]
fn the_sheet_and_its_uncertainty_are_right() {
    let (mut inside, mut total) = (0, 0);
    for seed in 0..20 {
        let (world, poses) = session(seed);
        let mut seen = views(&world, &poses);
        for (k, view) in (100 * (seed + 1)..).zip(&mut seen) {
            *view = see(&world, &poses[(k % 100) as usize], k, 0.0);
        }
        let fitted = calibrate(&seen, &options()).unwrap();
        let (from, along) = world.lens.ray(&Vector2::new(300.0, 320.0)).unwrap();
        let far = world.offset_m / world.normal.dot(&along);
        let at = fitted.map.coordinates(&(from + along * far));
        let plane = fitted.map.to_plane(300.0, 320.0).unwrap();
        let d = Vector2::new(plane.xi_m, plane.eta_m) - at;
        let z = d.dot(&(plane.covariance_m2.try_inverse().unwrap() * d));
        // Once in 10 000 by chance.
        assert!(z < 18.4, "{d} {}", plane.covariance_m2);
        inside += u32::from(z < 5.991);
        total += 1;
        assert_eq!(
            fitted.views.iter().filter(|v| v.left_out.is_some()).count(),
            0
        );
    }
    // 95 % of 20: 16 or fewer happen once in 60.
    assert!(inside >= 16, "{inside} of {total}");
}

#[test]
fn parallel_boards_say_nothing_about_the_focal_length() {
    let (world, poses) = session(1);
    let same = poses
        .iter()
        .map(|p| Pose {
            rotation: poses[0].rotation,
            ..*p
        })
        .collect::<Vec<_>>();
    let error = calibrate(&views(&world, &same), &options()).unwrap_err();
    assert!(
        matches!(error, FreeError::Parallel { boards: 12, .. }),
        "{error}"
    );
}

#[test]
fn lines_at_one_place_fix_no_plane() {
    let world = world();
    let poses: Vec<Pose> = (0..8)
        .map(|k| pose(&world, [0.0, 0.0], [0.5 * f64::from(k % 3) - 0.5, 0.0]))
        .collect();
    let error = calibrate(&views(&world, &poses), &options()).unwrap_err();
    assert!(matches!(error, FreeError::OneDistance { .. }), "{error}");
}

#[test]
fn a_zoom_that_changed_is_named_with_its_place() {
    let (mut world, poses) = session(3);
    let mut seen = views(&world, &poses);
    world.lens.numbers[FOCAL] *= 1.02;
    for k in 7..12 {
        seen[k] = see(&world, &poses[k], k as u64, 0.0);
    }
    let error = calibrate(&seen, &options()).unwrap_err();
    let FreeError::ZoomChanged { before, after, .. } = &error else {
        panic!("{error}")
    };
    assert_eq!((before.as_str(), after.as_str()), ("image 6", "image 7"));
}

#[test]
fn a_sheared_board_and_a_line_of_another_sheet_are_left_out() {
    let (world, poses) = session(4);
    let mut seen = views(&world, &poses);
    seen[5] = see(&world, &poses[5], 5, 3.0);
    for p in &mut seen[8].line {
        p.pixel[1] += 15.0;
    }
    let fitted = calibrate(&seen, &options()).unwrap();
    assert!(
        fitted.views[5].left_out.is_some(),
        "{:?}",
        fitted.views[5].rms_px
    );
    let off = fitted
        .reservations
        .iter()
        .any(|d| matches!(d, Reservation::LineOff { name, .. } if name == "image 8"));
    assert!(off, "{:?}", fitted.reservations);
}

#[test]
fn imported_intrinsics_are_a_prior_and_two_lines_are_too_few() {
    let (world, poses) = session(6);
    let mut seen = views(&world, &poses);
    let file = "intrinsics: [751.0, 751.0, 355.5, 291.5]\ndistortion_coeffs: [-0.12, 0, 0, 0]\nresolution: [720, 576]";
    let read = intrinsics::Intrinsics::parse(file).unwrap();
    let mut options = options();
    options.camera = read.over(options.camera, image()).unwrap();
    let fitted = calibrate(&seen, &options).unwrap();
    assert!((fitted.map.lens.numbers[FOCAL] - 750.0).abs() < 1.0);
    for view in &mut seen[2..] {
        view.line.clear();
    }
    let error = calibrate(&seen, &options).unwrap_err();
    assert!(
        matches!(error, FreeError::TooFewLines { found: 2, .. }),
        "{error}"
    );
    let other = ImageSize {
        width_px: 640,
        height_px: 480,
    };
    assert!(read.over(options.camera, other).is_err());
}
