//! Speed of the renderer: frames per second at 720 x 576 with noise.
//!
//! `cargo bench -p hydroline-sim`; `RAYON_NUM_THREADS=1` for one core.

use divan::{Bencher, counter::ItemsCount};
use fixture::lshpi_rig;
use hydroline_sim::scene::Pose6;
use hydroline_sim::{Renderer, World};

#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;

fn main() {
    divan::main();
}

/// A pose over the target with everything a little off, moving on from frame to frame.
fn pose(frame: u64) -> Pose6 {
    let t = frame as f64 * 0.04;
    Pose6 {
        x_m: 0.2 + 0.1 * t.sin(),
        y_m: 0.01 * t.cos(),
        z_m: -0.83 + 0.01 * t.sin(),
        phi_rad: 0.017 * t.sin(),
        theta_rad: 0.017 * t.cos(),
        psi_rad: -0.07,
    }
}

/// One frame after the other, each spread over all cores.
#[divan::bench(args = ["target", "floor", "target with shadows"])]
fn frames(bencher: Bencher, scene: &str) {
    let mut rig = lshpi_rig();
    rig.laser.shadows = scene.contains("shadows");
    if scene == "floor" {
        rig.target = None;
    }
    let Ok(renderer) = Renderer::new(&rig) else {
        return;
    };
    let mut pixels = vec![0; 720 * 576];
    let mut frame = 0;
    bencher.counter(ItemsCount::new(1usize)).bench_local(|| {
        frame += 1;
        renderer.render_into(&pose(frame), frame, divan::black_box(&mut pixels));
    });
}

/// Laser light alone, without noise.
#[divan::bench]
fn light_only(bencher: Bencher) {
    let Ok(renderer) = Renderer::new(&lshpi_rig()) else {
        return;
    };
    let mut frame = 0;
    bencher.counter(ItemsCount::new(1usize)).bench_local(|| {
        frame += 1;
        renderer.render_clean(&pose(frame))
    });
}

/// The analytic stripe of one pose.
#[divan::bench]
fn profile_truth(bencher: Bencher) {
    let Ok(renderer) = Renderer::new(&lshpi_rig()) else {
        return;
    };
    let mut frame = 0;
    bencher.counter(ItemsCount::new(1usize)).bench_local(|| {
        frame += 1;
        renderer.profile_truth(&pose(frame).into())
    });
}

/// 24 s of motion at 25 commands and poses per second.
#[divan::bench]
fn world_24_s(bencher: Bencher) {
    let rig = lshpi_rig();
    bencher.bench_local(|| {
        let Ok(mut world) = World::new(&rig, rig.tank.start_pose) else {
            return 0.0;
        };
        let mut x_m = 0.0;
        for i in 0..600 {
            let t_s = f64::from(i) * 0.04;
            let wrench = hydroline_rigs::Wrench {
                surge_n: if i % 100 < 50 { 8.0 } else { -8.0 },
                ..Default::default()
            };
            if world.command(t_s, &wrench).is_err() {
                return f64::NAN;
            }
            x_m = world.state_at(t_s).map_or(f64::NAN, |s| s.eta[0]);
        }
        x_m
    });
}
