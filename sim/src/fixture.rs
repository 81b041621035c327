//! The rig of geometry.md as a value, for tests and benches of crates that need one without files.

use std::f64::consts::PI;

use hydroline_rigs::{
    AxisCoefficients, Camera, CameraBackend, ImageNoise, Laser, Link, LinkKind, LinkPort,
    LogSettings, Mounts, PixelFormat, Rig, Slab, SlabOutline, Tank, Target, ThrustCurve, Thruster,
    ThrusterSet, Tolerance, Vehicle, VehicleModel,
};

/// Blue Robotics T200 at 16 V, coarsely: +51.5 / -39.9 N at the ends, flat around neutral.
pub fn t200_curve() -> ThrustCurve {
    ThrustCurve {
        points: vec![
            (1100.0, -39.9),
            (1200.0, -27.5),
            (1300.0, -15.6),
            (1400.0, -5.2),
            (1472.0, 0.0),
            (1528.0, 0.0),
            (1600.0, 6.6),
            (1700.0, 19.9),
            (1800.0, 34.8),
            (1900.0, 51.5),
        ],
    }
}

/// Board 0.30 m wide and six hexagons of side 0.12 m on it, each 0.02 m thick (geometry.md).
pub fn hexagon_target() -> Target {
    let side_m = 0.12;
    let length_m = 6.0 * 3f64.sqrt() * side_m;
    Target {
        name: "hexagons".into(),
        slabs: vec![
            Slab {
                name: "board".into(),
                outline: SlabOutline::Rectangle {
                    x0_m: 0.0,
                    x1_m: length_m,
                    width_m: 0.30,
                },
                top_m: 0.02,
                albedo: 1.0,
            },
            Slab {
                name: "hexagons".into(),
                outline: SlabOutline::HexagonChain {
                    x0_m: 0.0,
                    side_m,
                    count: 6,
                },
                top_m: 0.04,
                albedo: 1.0,
            },
        ],
        origin: [0.0; 3],
    }
}

/// Eight thrusters (four vectored, four vertical), as on a common small vehicle: spans all six DOFs.
fn thrusters() -> ThrusterSet {
    let h = 0.5f64.sqrt();
    let horizontal = [
        (0.16, 0.11, h, -h),
        (0.16, -0.11, h, h),
        (-0.16, 0.11, h, h),
        (-0.16, -0.11, h, -h),
    ];
    let vertical = [(0.12, 0.22), (0.12, -0.22), (-0.12, 0.22), (-0.12, -0.22)];
    let horizontal = horizontal.map(|(x, y, dx, dy)| ([x, y, 0.0], [dx, dy, 0.0]));
    let vertical = vertical.map(|(x, y)| ([x, y, 0.0], [0.0, 0.0, 1.0]));
    let thrusters = horizontal.into_iter().chain(vertical).enumerate();
    ThrusterSet {
        link: Link {
            kind: LinkKind::Stamped,
            port: LinkPort::Sim,
            baud: 115_200,
            rate_hz: 25.0,
            deadline_s: 0.05,
            timeout_s: 0.5,
        },
        thrusters: thrusters
            .map(|(i, (position_m, direction))| Thruster {
                name: format!("t{}", i + 1),
                channel: i as u8,
                position_m,
                direction,
                curve: t200_curve(),
            })
            .collect(),
        neutral_us: 1500.0,
        min_us: 1100.0,
        max_us: 1900.0,
        max_slew_us_per_s: 4000.0,
    }
}

fn coefficients(rows: [[f64; 3]; 6]) -> [AxisCoefficients; 6] {
    rows.map(|[added, linear, quadratic]| AxisCoefficients {
        added,
        linear,
        quadratic,
    })
}

/// The paper's rig with the choices of geometry.md: 720 x 576, vertical field of view 36 deg, square pixels.
pub fn lshpi_rig() -> Rig {
    let focal_px = 288.0 / (PI / 10.0).tan();
    Rig {
        name: "lshpi".into(),
        camera: Camera {
            backend: CameraBackend::Sim,
            pixel_format: PixelFormat::Grey,
            width_px: 720,
            height_px: 576,
            rate_fps: 25.0,
            exposure_s: 0.0,
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: 359.5,
            cy_px: 287.5,
            controls: Vec::new(),
            noise: ImageNoise {
                blur_px: 0.7,
                read_sd: 2.0,
                shot_gain: 0.0,
                ambient: 10.0,
            },
            seed: 1,
            frozen_after_s: 1.0,
        },
        laser: Laser {
            fan_rad: 40f64.to_radians(),
            sigma_m: 0.002,
            peak: 200.0,
            shadows: false,
        },
        mounts: Mounts {
            l_laser_m: 0.27,
            l_camera_m: 0.19,
            h_camera_m: 0.22,
            h_centre_m: 0.68,
            camera_tilt_rad: PI / 4.0,
        },
        target: Some(hexagon_target()),
        board: None,
        thrusters: thrusters(),
        vehicle: Vehicle {
            model: VehicleModel::Eq1,
            mass_kg: 29.777,
            inertia_kgm2: [0.730, 2.352, 2.144],
            r_bz_m: -0.028,
            gravity_mps2: 9.81,
            coefficients: coefficients([
                [-250.0, -20.0, -200.0],
                [-320.0, -30.0, -350.0],
                [-360.0, -35.0, -400.0],
                [-4.0, -1.5, -5.0],
                [-12.0, -3.0, -15.0],
                [-10.0, -2.5, -12.0],
            ]),
        },
        tank: Tank {
            n_water: 1.0,
            start_pose: [0.0, 0.0, -0.83, 0.0, 0.0, -4f64.to_radians()],
            x_m: [-2.0, 8.0],
            y_m: [-2.0, 2.0],
            depth_m: 1.5,
        },
        limits: hydroline_rigs::Limits {
            x_m: [-1.0, 7.0],
            y_m: [-1.5, 1.5],
            z_m: [-1.3, -0.35],
            attitude_rad: 25f64.to_radians(),
        },
        physics: Vec::new(),
        tolerance: Tolerance {
            position_m: 0.002,
            attitude_rad: 0.1f64.to_radians(),
        },
        log: LogSettings {
            queue_bytes: 256 << 20,
            chunk_bytes: 1 << 20,
            chunk_age_s: 1.0,
            command_flush_s: 0.04,
            sync_s: 2.0,
            rotate_bytes: 0,
            min_free_bytes: 1 << 30,
            zstd_level: 1,
        },
        effective_toml: String::new(),
    }
}
