//! The registry: ONE line per effect.

use super::{EffectInfo, Law, Values};
use crate::real::Real;

macro_rules! registry {
    ($($module:ident),+ $(,)?) => {
        /// Every effect of the vocabulary, in registry order.
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
    thruster_deadband,
    thrust_asymmetry,
    thruster_lag,
    current,
}

/// The effect with this id.
pub fn find(id: &str) -> Option<&'static EffectInfo> {
    ALL.iter().copied().find(|info| info.id == id)
}
