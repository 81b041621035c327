//! The kinds of frames of the table, each drawn from a seed.

use super::scene::{Banding, Scene, Thing};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Contents of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Clean,
    Steps,
    BarThin,
    BarWide,
    BarSoft,
    Bars,
    Lamp,
    Lamps,
    WindowHard,
    WindowSoft,
    ReflectionShort,
    ReflectionDim,
    BandingFlat,
    BandingTilted,
    BandingFine,
    Ceiling,
    Ceiling235,
    Ceiling240,
    CeilingBare,
    Tone,
    Black,
    Jpeg90,
    Jpeg75,
    Jpeg60,
    JpegBar,
    Everything,
}

impl Kind {
    pub const ALL: [Self; 26] = [
        Self::Clean,
        Self::Steps,
        Self::BarThin,
        Self::BarWide,
        Self::BarSoft,
        Self::Bars,
        Self::Lamp,
        Self::Lamps,
        Self::WindowHard,
        Self::WindowSoft,
        Self::ReflectionShort,
        Self::ReflectionDim,
        Self::BandingFlat,
        Self::BandingTilted,
        Self::BandingFine,
        Self::Ceiling,
        Self::Ceiling235,
        Self::Ceiling240,
        Self::CeilingBare,
        Self::Tone,
        Self::Black,
        Self::Jpeg90,
        Self::Jpeg75,
        Self::Jpeg60,
        Self::JpegBar,
        Self::Everything,
    ];

    /// A frame of this kind.
    pub fn scene(self, seed: u64) -> Scene {
        let mut rng = StdRng::seed_from_u64(seed.wrapping_mul(1009) + self as u64);
        let mut within = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        let mut scene = Scene {
            sigma_px: within(0.9, 4.0).min(within(0.9, 4.0)),
            peak: 40.0 * 4.5f64.powf(within(0.0, 1.0)),
            slope: within(-0.15, 0.15),
            undulation: (within(0.0, 6.0), within(200.0, 800.0), within(0.0, 6.3)),
            background: within(6.0, 30.0),
            noise_sd: within(1.0, 3.0),
            seed,
            ..Scene::default()
        };
        scene.row0_px = within(200.0, 380.0) - 360.0 * scene.slope;
        let side = if within(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let middle = scene.row_px(360.0);
        let brightness = |a: f64| 0.4 * 5.0f64.powf(a);
        let bar = |first_row: f64, rows: f64, level: f64, edge_px: f64| Thing::Bar {
            first_row,
            rows,
            level,
            edge_px,
        };
        let far = side * within(90.0, 150.0);
        match self {
            Self::Clean => {}
            Self::Steps => {
                let drop = side * within(12.0, 45.0);
                scene.undulation.0 = 0.0;
                scene.steps = vec![(within(120.0, 300.0), drop), (within(400.0, 600.0), -drop)];
            }
            Self::BarThin | Self::JpegBar => {
                let level = (scene.peak * brightness(within(0.0, 1.0))).min(220.0);
                scene.things = vec![bar(middle + far, within(4.0, 10.0).round(), level, 0.3)];
            }
            Self::BarWide => {
                let level = (scene.peak * brightness(within(0.0, 1.0))).min(220.0);
                scene.things = vec![bar(middle + far, within(10.0, 60.0).round(), level, 0.4)];
            }
            Self::BarSoft => {
                let level = (scene.peak * brightness(within(0.0, 1.0))).min(220.0);
                let rows = within(8.0, 60.0);
                scene.things = vec![bar(middle + far, rows, level, within(0.7, 3.0))];
            }
            Self::Bars => {
                for k in 0..4 {
                    let level = (scene.peak * brightness(within(0.0, 1.0))).min(220.0);
                    let first = middle + [-180.0, -120.0, 80.0, 130.0][k] + within(-10.0, 10.0);
                    scene.things.push(bar(first, within(4.0, 30.0), level, 0.7));
                }
            }
            Self::Lamp | Self::Lamps => {
                for _ in 0..if self == Self::Lamp { 1 } else { 5 } {
                    scene.things.push(Thing::Lamp {
                        column: within(0.0, 720.0),
                        row: middle + within(-200.0, 200.0),
                        sigma_px: within(4.0, 60.0),
                        level: (scene.peak * brightness(within(0.0, 1.0))).min(200.0),
                    });
                }
            }
            Self::WindowHard | Self::WindowSoft => {
                let (left, top) = (within(-50.0, 400.0), middle + far);
                let tall = within(30.0, 150.0);
                scene.things.push(Thing::Window {
                    columns: (left, left + within(100.0, 350.0)),
                    rows: if far < 0.0 {
                        (top - tall, top)
                    } else {
                        (top, top + tall)
                    },
                    level: (scene.peak * brightness(within(0.0, 1.0))).min(220.0),
                    edge_px: if self == Self::WindowHard {
                        0.5
                    } else {
                        within(2.0, 10.0)
                    },
                });
            }
            Self::ReflectionShort => {
                let left = within(0.0, 400.0);
                scene.things.push(Thing::Reflection {
                    columns: (left, left + within(100.0, 320.0)),
                    offset_px: side * within(25.0, 120.0),
                    slope: within(-0.1, 0.1),
                    sigma_px: scene.sigma_px * within(0.8, 1.3),
                    level: scene.peak * within(0.5, 1.3),
                });
            }
            Self::ReflectionDim => {
                scene.things.push(Thing::Reflection {
                    columns: (0.0, 720.0),
                    offset_px: side * within(60.0, 120.0),
                    slope: scene.slope,
                    sigma_px: scene.sigma_px * within(0.9, 1.3),
                    level: scene.peak * within(0.2, 0.6),
                });
            }
            Self::BandingFlat | Self::BandingTilted | Self::BandingFine => {
                let fine = self == Self::BandingFine;
                scene.banding = Banding {
                    level: within(1.0, 6.0),
                    period_px: if fine {
                        within(8.0, 40.0)
                    } else {
                        within(40.0, 200.0)
                    },
                    phase: within(0.0, 6.3),
                    drift: within(-1.0, 1.0),
                };
                if self == Self::BandingFlat {
                    scene.slope = within(-0.005, 0.005);
                    scene.undulation.0 = within(0.0, 1.0);
                    scene.row0_px = middle;
                }
            }
            Self::Ceiling | Self::Ceiling235 | Self::Ceiling240 | Self::CeilingBare => {
                let maximum = match self {
                    Self::Ceiling235 => 235.0,
                    Self::Ceiling240 => 240.0,
                    _ => within(200.0, 255.0).round(),
                };
                scene.range = (within(0.0, 20.0).round(), maximum);
                scene.peak = if self == Self::CeilingBare {
                    within(225.0, 270.0)
                } else {
                    within(280.0, 450.0)
                };
            }
            Self::Tone => {
                scene.gamma = within(0.45, 1.4);
                scene.peak = scene.peak.max(80.0);
            }
            Self::Black => {
                scene.background = within(-6.0, 2.0);
            }
            Self::Jpeg90 | Self::Jpeg75 | Self::Jpeg60 | Self::Everything => {}
        }
        scene.jpeg = match self {
            Self::Jpeg90 | Self::JpegBar => Some(within(85.0, 95.0) as u8),
            Self::Jpeg75 => Some(within(70.0, 80.0) as u8),
            Self::Jpeg60 => Some(within(60.0, 64.0) as u8),
            _ => None,
        };
        if self == Self::Everything {
            scene.peak = scene.peak.max(80.0);
            scene.things = vec![
                bar(middle + far, within(5.0, 30.0), 0.8 * scene.peak, 0.7),
                Thing::Lamp {
                    column: within(0.0, 720.0),
                    row: middle - far,
                    sigma_px: within(5.0, 30.0),
                    level: 120.0,
                },
            ];
            scene.banding = Banding {
                level: within(0.5, 3.0),
                period_px: within(50.0, 180.0),
                phase: within(0.0, 6.3),
                drift: 0.0,
            };
            scene.range = (16.0, 235.0);
            scene.gamma = within(0.8, 1.1);
        }
        scene
    }
}
