//! The closed form against the renderer, and its derivatives against differences of itself.

use super::plan::groups;
use super::turned::Turned;
use super::*;
use hydroline_calib::IdealMap;
use hydroline_sim::fixture::lshpi_rig;
use hydroline_sim::{Pose6, Renderer};

fn model() -> Photometric {
    let rig = lshpi_rig();
    let table = SheetTable::new(&IdealMap::of(&rig), &rig.camera, &rig.mounts);
    Photometric::new(
        Surfaces::new(rig.target.as_ref()),
        Arc::new(table),
        rig.camera.noise.blur_px,
        rig.laser.fan_rad,
    )
}

fn state(x_m: f64) -> State {
    let pose = Pose {
        x_m,
        y_m: 0.004,
        z_m: -0.826,
        phi_rad: 0.01,
        theta_rad: -0.008,
        psi_rad: -0.05,
    };
    State {
        pose,
        brightness: 200.0,
        thickness_m: 0.002,
        background: 0.0,
    }
}

fn at_row(
    model: &Photometric,
    plan: &Plan,
    state: &State,
    strips: &[Strip],
    row: usize,
) -> Option<Light> {
    let turned = Turned::new(&state.pose, &model.surfaces);
    let mut found = None;
    model.each_row(&turned, plan, state, strips, |at, light| {
        if at == row {
            found = light;
        }
    });
    found
}

#[test]
fn derivatives_are_those_of_the_light() {
    let model = model();
    let at = state(0.13);
    let plan = model.plan(&at, Choice::ALL);
    let steps = [1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-3, 1e-7];
    let mut compared = 0;
    for strips in groups(&plan.strips).step_by(3) {
        for row in strips[0].first_row..strips[0].end_row {
            let light = |s: &State| at_row(&model, &plan, s, strips, row);
            let Some(here) = light(&at) else {
                continue;
            };
            let exact = here.j;
            if here.level < 1.0 {
                continue;
            }
            for (k, h) in steps.iter().enumerate() {
                let moved = |by: f64| {
                    let mut step = Column::zeros();
                    step[k] = by;
                    light(&at.moved(&step)).unwrap().level
                };
                let difference = (moved(*h) - moved(-h)) / (2.0 * h);
                // Slopes of edge and stripe within one point spread are held: a hundredth.
                let scale = if k < 6 {
                    2e5
                } else {
                    200.0 / at.thickness_m.powi(i32::from(k == 7))
                };
                assert!(
                    (difference - exact[k]).abs() < 0.01 * scale,
                    "{k}: {difference} {}",
                    exact[k]
                );
            }
            compared += 1;
        }
    }
    assert!(compared > 1000, "{compared}");
}

#[test]
fn light_is_the_renderers() {
    let (model, rig) = (model(), lshpi_rig());
    let renderer = Renderer::new(&rig).unwrap();
    // On a flank, at a joint, at a widest point and beside it.
    for x_m in [0.13, 0.1457, 0.2496, 0.243, 0.256, 0.262] {
        let at = state(x_m);
        let picture = renderer.render_clean(&Pose6::from(at.pose.to_array()));
        let plan = model.plan(&at, Choice::ALL);
        let (mut square, mut count, mut worst) = (0.0, 0.0, 0.0f64);
        for strips in groups(&plan.strips) {
            for row in strips[0].first_row..strips[0].end_row {
                let light = at_row(&model, &plan, &at, strips, row).unwrap().level;
                let seen = f64::from(picture[row * model.table.width_px + strips[0].column]);
                let difference = light - seen;
                square += difference * difference;
                count += 1.0;
                worst = worst.max(difference.abs());
            }
        }
        let rms = (square / count).sqrt();
        println!("x {x_m}: rms {rms:.3} grey levels of 200, worst {worst:.2}, {count} pixels");
        assert!(rms < 0.6, "x {x_m}: {rms}");
    }
}

#[test]
fn strips_that_no_edge_cuts_add_up_to_what_their_pixels_do() {
    let model = model();
    let rig = lshpi_rig();
    let at = State {
        background: rig.camera.noise.ambient,
        ..state(0.13)
    };
    let renderer = Renderer::new(&rig).unwrap();
    let picture = renderer
        .render(&Pose6::from(state(0.1301).pose.to_array()), 1)
        .0;
    let weighting = Weighting {
        noise_sd: 2.0,
        cut: 4.0,
        redescending: false,
        saturation: 254,
    };
    let mut plan = model.plan(&at, Choice::ALL);
    let alone = |g: &[Strip]| g.len() == 1 && !g[0].cut();
    plan.strips = groups(&plan.strips)
        .filter(|g| alone(g))
        .map(|g| g[0])
        .collect();
    let fast = model.compare(
        &plan,
        &picture,
        &at,
        &weighting,
        &mut Doubts::default(),
        true,
    );
    let mut counter = Counter::new(&weighting, Tables::get(), at.brightness);
    for strips in groups(&plan.strips) {
        for row in strips[0].first_row..strips[0].end_row {
            let light = at_row(&model, &plan, &at, strips, row).unwrap();
            let grey = picture[row * model.table.width_px + strips[0].column];
            let judged = counter.bulk(grey, light.level, at.background).unwrap();
            let mut j = light.j;
            j[BACKGROUND] = 1.0;
            let j = j.map(|d| d * judged.share);
            counter.add(&BULK, &j, judged.weight, judged.residual);
        }
    }
    let slow = counter.done();
    assert_eq!(fast.pixels, slow.pixels);
    assert!(
        (fast.cost / slow.cost - 1.0).abs() < 1e-5,
        "{} {}",
        fast.cost,
        slow.cost
    );
    for a in BULK {
        for b in BULK {
            let size = (slow.information[(a, a)] * slow.information[(b, b)]).sqrt();
            let off = (fast.information[(a, b)] - slow.information[(a, b)]).abs() / size;
            assert!(off < 1e-4, "{a} {b}: {off}");
        }
        let sd = slow.information[(a, a)].sqrt();
        let off = (fast.gradient[a] - slow.gradient[a]).abs() / sd;
        assert!(off < 0.05, "{a}: {off} sd");
    }
}

#[test]
fn strips_that_single_edges_cut_add_up_to_what_their_pixels_do() {
    let model = model();
    let rig = lshpi_rig();
    let renderer = Renderer::new(&rig).unwrap();
    let weighting = Weighting {
        noise_sd: 2.0,
        cut: 4.0,
        redescending: false,
        saturation: 254,
    };
    // Flanks, joints, widest points.
    for x_m in [0.13, 0.1457, 0.2496, 0.243, 0.31] {
        let at = State {
            background: rig.camera.noise.ambient,
            ..state(x_m)
        };
        let truth = Pose6::from(state(x_m + 2e-4).pose.to_array());
        let picture = renderer.render(&truth, 1).0;
        let plan = model.plan(&at, Choice::ALL);
        let mut slow = plan.clone();
        slow.strips.iter_mut().for_each(|s| s.simple = false);
        let sums = |plan: &Plan| {
            let mut doubts = Doubts {
                share: Some(0.03),
                ..Doubts::default()
            };
            let once = model.compare(plan, &picture, &at, &weighting, &mut doubts, true);
            let again = model.compare(plan, &picture, &at, &weighting, &mut doubts, true);
            assert!((once.cost / again.cost - 1.0).abs() < 1e-6);
            again
        };
        let (fast, slow) = (sums(&plan), sums(&slow));
        let (mut torn, mut simple) = (0, 0);
        for group in groups(&plan.strips).filter(|g| g.iter().any(Strip::cut)) {
            torn += 1;
            simple += usize::from(group.iter().all(|s| s.simple));
        }
        println!("x {x_m}: {simple} of {torn} groups are simple");
        assert!(2 * simple > torn, "x {x_m}: {simple} of {torn}");
        assert_eq!(fast.pixels, slow.pixels);
        assert!(
            (fast.cost / slow.cost - 1.0).abs() < 1e-4,
            "{} {}",
            fast.cost,
            slow.cost
        );
        for a in ALL {
            for b in ALL {
                let size = (slow.information[(a, a)] * slow.information[(b, b)]).sqrt();
                let off = (fast.information[(a, b)] - slow.information[(a, b)]).abs() / size;
                // Half a per cent of the information is a quarter of a per cent of an sd.
                assert!(off < 5e-3, "x {x_m}: {a} {b}: {off}");
            }
            let sd = slow.information[(a, a)].sqrt();
            let off = (fast.gradient[a] - slow.gradient[a]).abs() / sd;
            assert!(off < 0.05, "x {x_m}: {a}: {off} sd");
        }
    }
}

#[test]
#[ignore]
fn residuals_of_independent_frames() {
    use crate::log::{LogReader, Record};
    let Ok(dir) = std::env::var("HYDROLINE_SHARED") else {
        return;
    };
    let model = model();
    for name in ["surge-4n", "yaw"] {
        let path = std::path::PathBuf::from(&dir).join(format!("cases/images/{name}.mcap"));
        let (mut images, mut truths) = (Vec::new(), Vec::new());
        for message in LogReader::open(&path).unwrap() {
            match message.unwrap().record {
                Record::Frame(frame) => {
                    images.push((frame.meta.mid_exposure_ns, frame.to_grey().unwrap()))
                }
                Record::Truth(t) => {
                    let stamp = t
                        .timestamp
                        .as_ref()
                        .map_or(0, crate::log::messages::unix_ns);
                    let pose = [t.x_m, t.y_m, t.z_m, t.phi_rad, t.theta_rad, t.psi_rad]
                        .map(Option::unwrap_or_default);
                    truths.push((stamp, Pose::from_array(pose)));
                }
                _ => {}
            }
        }
        let mut bulk: Vec<[f64; 9]> = vec![[0.0; 9]; 720];
        for (frame, (stamp, image)) in images.iter().enumerate() {
            let truth = truths
                .iter()
                .min_by_key(|(t, _)| t.abs_diff(*stamp))
                .unwrap()
                .1;
            let mut at = State {
                pose: truth,
                brightness: 200.0,
                thickness_m: 0.002,
                background: 12.0,
            };
            let weighting = Weighting {
                noise_sd: 1.6,
                cut: 5.0,
                redescending: false,
                saturation: 254,
            };
            for _ in 0..6 {
                let plan = model.plan(&at, Choice::ALL);
                let sums = model.compare(
                    &plan,
                    &image.pixels,
                    &at,
                    &weighting,
                    &mut Doubts::default(),
                    true,
                );
                let h = nalgebra::Matrix3::from_fn(|i, k| sums.information[(6 + i, 6 + k)]);
                let g = nalgebra::Vector3::from_fn(|i, _| sums.gradient[6 + i]);
                let step = h.lu().solve(&g).unwrap();
                at.brightness += step[0];
                at.thickness_m += step[1];
                at.background += step[2];
            }
            println!(
                "{name} {frame}: light {:.2} {:.6} {:.3}",
                at.brightness, at.thickness_m, at.background
            );
            let plan = model.plan(&at, Choice::ALL);
            // (column, row) -> residual, jx, jy
            let mut torn: Vec<(usize, usize, f64, [f64; 9])> = Vec::new();
            let turned = Turned::new(&at.pose, &model.surfaces);
            for strips in groups(&plan.strips) {
                let column = strips[0].column;
                model.each_row(&turned, &plan, &at, strips, |row, light| {
                    let Some(l) = light else { return };
                    let r = f64::from(image.pixels[row * 720 + column]) - l.level - at.background;
                    if l.torn && l.doubt.corner < 0.5 {
                        if l.j[1].abs() > 2000.0 {
                            torn.push((column, row, r, l.j));
                        }
                    } else if strips.len() == 1 && !strips[0].cut() {
                        let b = &mut bulk[column];
                        let by_z = l.j[2];
                        b[0] += by_z * r;
                        b[1] += by_z * by_z;
                        b[2] += l.j[6] * r;
                        b[3] += l.j[6] * l.j[6];
                        b[4] += l.j[7] * r;
                        b[5] += l.j[7] * l.j[7];
                        b[6] += r * r;
                        b[7] += 1.0;
                        b[8] += l.j[6] * l.j[7];
                    }
                });
            }
            torn.sort_by_key(|t| (t.0, t.1));
            let mut from = 0;
            for i in 1..=torn.len() {
                if i < torn.len() && torn[i].0 - torn[i - 1].0 <= 3 {
                    continue;
                }
                let cluster = &torn[from..i];
                from = i;
                let shift = |of: &mut dyn Iterator<Item = &(usize, usize, f64, [f64; 9])>| {
                    let (mut a, mut b, mut n) = (0.0, 0.0, 0);
                    for t in of {
                        a += t.2 * t.3[1];
                        b += t.3[1] * t.3[1];
                        n += 1;
                    }
                    (1e3 * a / b, 1e3 * 1.6 / b.sqrt(), n)
                };
                let all = shift(&mut cluster.iter());
                let chi: f64 =
                    cluster.iter().map(|t| t.2 * t.2).sum::<f64>() / cluster.len() as f64;
                println!(
                    "  cols {}-{} rows {}..: dy {:.3} mm (sd {:.3}) n {} rms {:.2}",
                    cluster[0].0,
                    cluster[cluster.len() - 1].0,
                    cluster.iter().map(|t| t.1).min().unwrap(),
                    all.0,
                    all.1,
                    all.2,
                    chi.sqrt()
                );
                if frame % 9 == 4 {
                    let (low, high) = (
                        cluster.iter().map(|t| t.1).min().unwrap(),
                        cluster.iter().map(|t| t.1).max().unwrap(),
                    );
                    let mut text = String::new();
                    for row in low..=high {
                        let s = shift(&mut cluster.iter().filter(|t| t.1 == row));
                        if s.1 < 0.2 {
                            text += &format!(" {row}:{:.2}({:.2})", s.0, s.1);
                        }
                    }
                    println!("    rows{text}");
                }
            }
        }
        for (c, b) in bulk
            .iter()
            .enumerate()
            .step_by(1)
            .collect::<Vec<_>>()
            .chunks(20)
            .map(|c| {
                let mut sum = [0.0; 9];
                for (_, b) in c {
                    for k in 0..9 {
                        sum[k] += b[k];
                    }
                }
                (c[0].0, sum)
            })
        {
            if b[7] > 0.0 {
                println!(
                    "bulk {c}: dz {:.4} mm (sd {:.4}) brightness {:.2} (sd {:.2}) thick {:.3} um (sd {:.3}) rms {:.3}",
                    1e3 * b[0] / b[1],
                    1.6e3 / b[1].sqrt(),
                    b[2] / b[3],
                    1.6 / b[3].sqrt(),
                    1e6 * b[4] / b[5],
                    1.6e6 / b[5].sqrt(),
                    (b[6] / b[7]).sqrt()
                );
            }
        }
    }
}
