//! The built-in rig for tests of the forward model and of what rests on it: under way at psi = -4 deg (the paper's
//! surge runs), a background that noise cannot clip, and an instantaneous exposure.
#![allow(dead_code, clippy::unwrap_used)]

use hydroline_rigs::{Rig, Target};

/// `rigs/lshpi.toml` with the start pose x = 0, psi = -4 deg, ambient 10 grey levels, exposure 0.
pub fn lshpi_rig() -> Rig {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.camera.noise.ambient = 10.0;
    rig.camera.exposure_s = 0.0;
    rig.tank.start_pose = [0.0, 0.0, -0.83, 0.0, 0.0, -4f64.to_radians()];
    rig
}

/// The hexagon target of theory/geometry.md.
pub fn hexagon_target() -> Target {
    lshpi_rig().target.unwrap()
}
