//! The registry: ONE line per effect.

use super::{EffectInfo, Law, Values};
use crate::real::Real;

macro_rules! registry {
    ($($module:ident),+ $(,)?) => {
        /// Every effect of the library, in registry order.
        pub const ALL: &[&EffectInfo] = &[$(&super::$module::INFO),+];

        /// The law of an effect in the scalar `T`; `None` only for an info that is not in [`ALL`].
        pub(super) fn law<T: Real>(values: &Values<'_, T>) -> Option<Box<dyn Law<T>>> {
            $(if values.info.id == super::$module::INFO.id {
                return Some(Box::new(super::$module::law(values)));
            })+
            None
        }
    };
}

registry! {
    camera_latency,
    clock_drift,
    command_latency,
    rolling_shutter,
    interlace,
    thruster_deadband,
    thruster_saturation,
    thrust_asymmetry,
    battery_sag,
    thruster_lag,
    shaft_thrust,
    advance_loss,
    thrust_line_offset,
    thrust_scale,
    current,
    seiche,
    constant_force,
    tether_spring,
    linear_damping,
    quadratic_damping,
    cubic_damping,
    astern_drag,
    lift_damping,
    coulomb_friction,
    fluid_memory,
    wall_added_mass,
    nonlinear_restoring,
    added_mass_coupling,
    cross_flow_coupling,
    free_force,
    written_force,
    fin_force,
    wave_force,
    refraction,
    lens_distortion,
    camera_shift,
    laser_plane_tilt,
    laser_cone,
    board_offset,
    target_scale,
    position_scale,
    floor_slope,
    backscatter_haze,
    image_saturation,
    speckle,
    attenuation,
    line_profile,
    lens_shading,
    ambient_gradient,
    mains_banding,
    tone_curve,
    range_clipping,
    attitude_disturbance,
}

impl EffectInfo {
    /// Ids of the effects that it can be mistaken for: those of its own list, then those that list it, in registry order.
    pub fn confusable_with(&self) -> Vec<&'static str> {
        let mut ids = self.confusable.to_vec();
        let listing = ALL
            .iter()
            .filter(|other| other.confusable.contains(&self.id));
        for other in listing {
            if !ids.contains(&other.id) {
                ids.push(other.id);
            }
        }
        ids
    }
}

/// The effect with this id.
pub fn find(id: &str) -> Option<&'static EffectInfo> {
    ALL.iter().copied().find(|info| info.id == id)
}
