//! Images of a tank without a board: nothing in them may become a node.

use nalgebra::Matrix3;
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::{Scene, finish};

/// Kinds of images without a board; `clutter` takes them in turn by its seed.
pub const CLUTTER_KINDS: [&str; 18] = [
    "noise",
    "gradient",
    "soft stripes",
    "sharp stripes",
    "caustics",
    "soft blobs",
    "laser line",
    "sharp spots",
    "cables",
    "bubbles",
    "text",
    "tiled floor",
    "plaid",
    "perforated plate",
    "bricks",
    "checkered floor",
    "steps and edges",
    "stained tiles",
];

/// An image without a board, of kind `seed` modulo the number of [`CLUTTER_KINDS`]; floors
/// and plates are endless, in perspective, and some lie under a laser line.
pub fn clutter(size: [usize; 2], seed: u64) -> Vec<u8> {
    let [w, h] = size;
    let (wf, hf) = (w as f64, h as f64);
    let mut rng = StdRng::seed_from_u64(seed ^ 0x5eed);
    let kind = (seed % CLUTTER_KINDS.len() as u64) as usize;
    let mut any = |low: f64, high: f64| rng.random_range(low..high);
    let tau = std::f64::consts::TAU;
    let (a, b, c, d) = (any(0.0, 6.3), any(6.0, 60.0), any(0.2, 1.0), any(0.0, 6.3));
    let mut image = match kind {
        0 => vec![120.0; w * h],
        1 => each(size, |x, y| {
            let along = x * a.cos() + y * a.sin();
            20.0 + 200.0 * (along / (wf + hf) + 0.5).clamp(0.0, 1.0)
        }),
        2 => each(size, |x, y| {
            120.0 + 90.0 * (tau * (x * a.cos() + y * a.sin()) / b).sin()
        }),
        3 => each(size, |x, y| {
            120.0 + 90.0 * (tau * (x * a.cos() + y * a.sin()) / b).sin().signum()
        }),
        // Waves that meet: caustics on a tank's floor.
        4 => each(size, |x, y| {
            let along = x * a.cos() + y * a.sin();
            let other = x * d.cos() + y * d.sin();
            120.0
                + 50.0 * (tau * along / b + 1.5 * (other / 47.0).sin()).sin()
                + 40.0 * (tau * other / (b * c + 9.0) + 2.0 * (along / 61.0).cos()).sin()
        }),
        // A laser stripe over a dark floor.
        6 => each(size, |x, y| {
            25.0 + 200.0 * (-0.5 * ((y - 250.0 - 0.1 * x) / 2.2f64).powi(2)).exp()
        }),
        11..=15 | 17 => {
            let floor = floor(size, &mut any);
            let mark = any(0.03, 0.25);
            let greys = [any(130.0, 220.0), any(10.0, 90.0)];
            let stained: Vec<bool> = (0..1024).map(|_| any(0.0, 1.0) < 0.04).collect();
            each(size, |x, y| {
                let Some([u, v]) = hydroline_calib::map::geometry::apply(&floor, [x, y]) else {
                    return greys[1]; // beyond the horizon
                };
                let (du, dv) = (u - u.round(), v - v.round());
                let dark = match kind {
                    11 | 17 => {
                        let cell = (u.floor() as i64 * 31 + v.floor() as i64).rem_euclid(1024);
                        let (mu, mv) = (u - u.floor() - 0.5, v - v.floor() - 0.5);
                        du.abs().min(dv.abs()) < 0.5 * mark
                            || (kind == 17 && stained[cell as usize] && mu.hypot(mv) < 0.25)
                    }
                    13 => du.hypot(dv) < (0.1 + mark),
                    14 => {
                        let shifted = u + 0.5 * v.floor().rem_euclid(2.0);
                        (shifted - shifted.round()).abs() < 0.25 * mark
                            || (v - v.floor()).min(v.ceil() - v) < 0.5 * mark
                    }
                    15 => (u.floor() + v.floor()).rem_euclid(2.0) < 0.5,
                    // A woven cloth: two gratings that meet at any angle.
                    _ => {
                        let s = 0.5
                            + 0.25 * (tau * u).sin()
                            + 0.25 * (tau * (v * c + u * (1.0 - c))).sin();
                        return greys[1] + (greys[0] - greys[1]) * s;
                    }
                };
                greys[usize::from(dark)]
            })
        }
        // Half planes over each other: steps, walls, a target's edges.
        16 => {
            let edges: Vec<[f64; 4]> = (0..14)
                .map(|_| [any(0.0, tau), any(0.0, wf), any(0.0, hf), any(-50.0, 50.0)])
                .collect();
            each(size, |x, y| {
                120.0
                    + edges
                        .iter()
                        .filter(|e| (x - e[1]) * e[0].cos() + (y - e[2]) * e[0].sin() > 0.0)
                        .map(|e| e[3])
                        .sum::<f64>()
            })
        }
        10 => vec![any(150.0, 220.0); w * h],
        _ => vec![120.0; w * h],
    };
    match kind {
        5 | 7 => {
            for _ in 0..160 {
                let (x, y) = (any(0.0, wf), any(0.0, hf));
                let (radius, grey) = (any(1.5, 12.0), any(-110.0, 110.0));
                stamp(&mut image, size, [x, y], 3.0 * radius, |dx, dy, v| {
                    let d = dx.hypot(dy);
                    if kind == 5 {
                        v + grey * (-0.5 * (d / radius).powi(2)).exp()
                    } else if d < radius {
                        v + grey
                    } else {
                        v
                    }
                });
            }
        }
        // Dark ropes that cross each other, straight and slack.
        8 => {
            for n in 0..24 {
                let (width, grey) = (any(1.0, 5.0), any(10.0, 80.0));
                let (x0, y0) = (any(0.0, wf), any(0.0, hf));
                // Half of them are laid in two directions, as mooring lines are.
                let angle = if n % 2 == 0 {
                    a + 1.57 * f64::from(n % 4 / 2)
                } else {
                    any(0.0, tau)
                };
                let (sag, long) = (any(0.0, 30.0), any(60.0, 300.0));
                for step in -1500..1500 {
                    let t = 0.5 * f64::from(step);
                    let off = sag * (t / long).sin();
                    let at = [
                        x0 + t * angle.cos() - off * angle.sin(),
                        y0 + t * angle.sin() + off * angle.cos(),
                    ];
                    stamp(&mut image, size, at, width + 1.0, |dx, dy, v| {
                        if dx.hypot(dy) < width { grey } else { v }
                    });
                }
            }
        }
        // Bright rims, dark inside, a glint on top.
        9 => {
            for _ in 0..260 {
                let (x, y, radius) = (any(0.0, wf), any(0.0, hf), any(1.5, 14.0));
                stamp(&mut image, size, [x, y], radius + 2.0, |dx, dy, v| {
                    let rho = dx.hypot(dy) / radius;
                    if (dx + 0.4 * radius).hypot(dy + 0.4 * radius) < 0.2 * radius {
                        245.0
                    } else if rho < 0.75 {
                        0.6 * v
                    } else if rho < 1.0 {
                        200.0
                    } else {
                        v
                    }
                });
            }
        }
        // Lines of letters, 5 × 7 points each, as on a label.
        10 => {
            let point = any(1.6, 6.0);
            let ink = any(10.0, 90.0);
            let tilt = any(-0.2, 0.2);
            let (columns, rows) = (
                (wf / (6.0 * point)) as i64 + 2,
                (hf / (9.0 * point)) as i64 + 2,
            );
            for row in -2..rows {
                for column in -2..columns {
                    if any(0.0, 1.0) < 0.15 {
                        continue; // a space
                    }
                    let letter: Vec<bool> = (0..35).map(|_| any(0.0, 1.0) < 0.45).collect();
                    for (n, _) in letter.iter().enumerate().filter(|(_, on)| **on) {
                        let x = (column as f64 * 6.0 + (n % 5) as f64) * point;
                        let y = (row as f64 * 9.0 + (n / 5) as f64) * point + tilt * x;
                        stamp(&mut image, size, [x, y], point, |dx, dy, v| {
                            if dx.abs().max(dy.abs()) <= 0.5 * point {
                                ink
                            } else {
                                v
                            }
                        });
                    }
                }
            }
        }
        _ => {}
    }
    let noise = if kind == 0 {
        any(2.0, 60.0)
    } else {
        any(0.5, 8.0)
    };
    let lit = any(0.0, 1.0) < 0.4;
    finish(
        image,
        &Scene {
            size,
            noise,
            blur_px: any(0.0, 1.5),
            light: [any(0.5, 1.1), any(0.5, 1.1), any(0.6, 1.0), any(0.6, 1.0)],
            stripe: lit.then_some([
                any(-200.0, 200.0),
                any(-0.3, 0.3),
                any(1.0, 3.0),
                any(40.0, 160.0),
            ]),
            seed,
            ..Scene::default()
        },
    )
}

/// Image to floor: pitch, turn and perspective of an endless pattern.
fn floor(size: [usize; 2], any: &mut impl FnMut(f64, f64) -> f64) -> Matrix3<f64> {
    let (pitch, angle) = (any(14.0, 90.0), any(0.0, std::f64::consts::TAU));
    // As often as not aligned with the image, as floors and walls are.
    let angle = if any(0.0, 1.0) < 0.5 {
        0.05 * angle
    } else {
        angle
    };
    let (s, c) = angle.sin_cos();
    let (squeeze, fall) = (any(0.5, 1.0), any(0.0, 0.7));
    let (x0, y0) = (0.5 * size[0] as f64, 0.5 * size[1] as f64);
    // Rows get closer towards the image's upper edge.
    let perspective = Matrix3::new(
        1.0,
        0.0,
        -x0,
        0.0,
        1.0 / squeeze,
        -y0 / squeeze,
        0.0,
        fall / y0,
        1.0,
    );
    Matrix3::new(
        c / pitch,
        -s / pitch,
        any(0.0, 1.0),
        s / pitch,
        c / pitch,
        any(0.0, 1.0),
        0.0,
        0.0,
        1.0,
    ) * perspective
}

/// Mean of nine places in every pixel.
fn each(size: [usize; 2], grey: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let mut image = Vec::with_capacity(size[0] * size[1]);
    for r in 0..size[1] {
        for c in 0..size[0] {
            let mut sum = 0.0;
            for y in [-1.0, 0.0, 1.0] {
                for x in [-1.0, 0.0, 1.0] {
                    sum += grey(c as f64 + x / 3.0, r as f64 + y / 3.0);
                }
            }
            image.push(sum / 9.0);
        }
    }
    image
}

/// Changes the pixels within `reach` of a place; the change is called with (dx, dy, old grey).
fn stamp(
    image: &mut [f64],
    size: [usize; 2],
    at: [f64; 2],
    reach: f64,
    change: impl Fn(f64, f64, f64) -> f64,
) {
    let span = |v: f64, n: usize| {
        let (low, high) = (
            (v - reach).ceil().max(0.0),
            (v + reach).floor().min(n as f64 - 1.0),
        );
        (low as i64)..(high as i64 + 1)
    };
    for r in span(at[1], size[1]) {
        for c in span(at[0], size[0]) {
            let pixel = &mut image[r as usize * size[0] + c as usize];
            *pixel = change(c as f64 - at[0], r as f64 - at[1], *pixel);
        }
    }
}
