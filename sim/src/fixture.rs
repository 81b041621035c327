//! The built-in rig as this crate's tests and benches want it: under way at psi = -4 deg (the paper's
//! surge runs), a background that noise cannot clip, and an instantaneous exposure.

use hydroline_rigs::{Rig, RigError, Target};

/// `rigs/lshpi.toml` with the start pose x = 0, psi = -4 deg, ambient 10 grey levels, exposure 0.
///
/// # Errors
/// None in practice: the file is part of the crate, and its own tests read it.
pub fn try_lshpi_rig() -> Result<Rig, RigError> {
    let mut rig = Rig::builtin("lshpi")?;
    rig.camera.noise.ambient = 10.0;
    rig.camera.exposure_s = 0.0;
    rig.tank.start_pose = [0.0, 0.0, -0.83, 0.0, 0.0, -4f64.to_radians()];
    Ok(rig)
}

/// [`try_lshpi_rig`] for tests.
///
/// # Panics
/// When the built-in rig does not parse.
#[allow(clippy::expect_used)]
pub fn lshpi_rig() -> Rig {
    try_lshpi_rig().expect("the built-in rig parses")
}

/// The hexagon target of theory/geometry.md.
///
/// # Panics
/// As [`lshpi_rig`].
#[allow(clippy::expect_used)]
pub fn hexagon_target() -> Target {
    lshpi_rig().target.expect("the built-in rig has a target")
}
