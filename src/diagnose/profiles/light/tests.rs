//! The look at the light on frames of the renderer.

use super::look;
use crate::profiles::anytime::Anytime;
use crate::profiles::candidate::{Base, library};
use crate::profiles::geometry::Geometry;
use crate::profiles::observe::{ImageRun, from_images};
use hydroline_core::frame::GreyImage;
use hydroline_inference::limit::Watch;
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::{Pose6, Renderer};

/// Three frames over the target, of a tank with these effects.
fn frames(rig: &Rig, effects: &[(&str, &[(&str, f64)])]) -> ImageRun {
    let mut tank = rig.clone();
    tank.camera.noise.ambient = 8.0;
    for (effect, numbers) in effects {
        let number = |(n, v): &(&str, f64)| ((*n).to_owned(), ParameterValue::Number(*v));
        tank.physics.push(PhysicsEntry {
            effect: (*effect).to_owned(),
            parameters: numbers.iter().map(number).collect(),
        });
    }
    let renderer = Renderer::new(&tank).unwrap();
    let images = (0..3u64).map(|k| {
        let x_m = -0.17 + 0.1 * k as f64;
        let pose = Pose6::from([x_m, 0.003, -0.83, 0.004, 0.003, -0.04]);
        let image = GreyImage {
            width_px: renderer.width_px(),
            height_px: renderer.height_px(),
            pixels: renderer.render(&pose, k).0,
        };
        (1_000_000_000 * (k + 1), image)
    });
    from_images("frames", &[], images.collect(), rig, None, 3).unwrap()
}

/// Effects found, each with its first number and the sd of that; and the ids of those asked.
fn found(effects: &[(&str, &[(&str, f64)])]) -> (Vec<(&'static str, f64, f64)>, Vec<&'static str>) {
    let rig = Rig::builtin("lshpi").unwrap();
    let base = Base::new(&rig).unwrap();
    let geometry = Geometry::new(&rig, base.optics(&[]).unwrap());
    let others = library(&base).len();
    let run = frames(&rig, effects);
    let asked = Anytime::new(Watch::unlimited(&|_| {}));
    let looked = look(&[run], &rig, &base, &geometry, others, &asked).unwrap();
    let asked = looked.candidates().iter().map(|c| c.info.id).collect();
    assert_eq!(looked.unnamed(), None);
    let of = |e: super::LightEffect| (e.info().id, e.effect.numbers[0], e.sds[0]);
    (looked.effects().into_iter().map(of).collect(), asked)
}

#[test]
fn what_a_law_does_to_the_light_makes_it_a_candidate_and_even_light_is_nothing() {
    let (found, asked) = found(&[]);
    assert!(found.is_empty(), "{found:?}");
    for id in [
        "lens_shading",
        "line_profile",
        "ambient_gradient",
        "tone_curve",
        "range_clipping",
        "mains_banding",
        "backscatter_haze",
    ] {
        assert!(asked.contains(&id), "{id}: {asked:?}");
    }
    for id in [
        "refraction",
        "target_scale",
        "laser_plane_tilt",
        "position_scale",
    ] {
        assert!(!asked.contains(&id), "{id}: {asked:?}");
    }
}

#[test]
fn a_shaded_lens_is_found_with_its_number() {
    let (found, _) = found(&[("lens_shading", &[("corner_loss", 0.2)])]);
    assert!(
        matches!(&found[..], [("lens_shading", v, sd)] if (v - 0.2).abs() < 3.0 * sd.max(0.002)),
        "{found:?}"
    );
}
