//! The closed form against the renderer, and its derivatives against differences of itself.

use super::passing::Doubt;
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

#[test]
fn derivatives_are_those_of_the_light() {
    let model = model();
    let at = state(0.13);
    let plan = model.plan(&at);
    let steps = [1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-3, 1e-7];
    let mut compared = 0;
    for strips in groups(&plan.strips).step_by(3) {
        for row in strips[0].first_row..strips[0].end_row {
            let light = |s: &State, j: &mut Column| {
                model.light(
                    &Turned::new(&s.pose),
                    s,
                    &plan,
                    strips,
                    row,
                    j,
                    &mut Doubt::default(),
                )
            };
            let mut exact = Column::zeros();
            let Some(value) = light(&at, &mut exact) else {
                continue;
            };
            if value < 1.0 {
                continue;
            }
            for (k, h) in steps.iter().enumerate() {
                let moved = |by: f64| {
                    let mut step = Column::zeros();
                    step[k] = by;
                    light(&at.moved(&step), &mut Column::zeros()).unwrap()
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
        let plan = model.plan(&at);
        let turned = Turned::new(&at.pose);
        let (mut square, mut count, mut worst) = (0.0, 0.0, 0.0f64);
        for strips in groups(&plan.strips) {
            for row in strips[0].first_row..strips[0].end_row {
                let light = model.light(
                    &turned,
                    &at,
                    &plan,
                    strips,
                    row,
                    &mut Column::zeros(),
                    &mut Doubt::default(),
                );
                let seen = f64::from(picture[row * model.table.width_px + strips[0].column]);
                let difference = light.unwrap() - seen;
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
