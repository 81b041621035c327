//! A prime system by its name, as `coefficients` and `rig import` take it.

use clap::ValueEnum;
use hydroline_coefficients::Prime;

/// A prime system by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum System {
    /// rho L3 / 2, L, L / U
    #[value(name = "I")]
    I,
    /// rho L2 T / 2, L, L / U
    #[value(name = "II")]
    II,
    /// m, L, sqrt(L / g): needs no speed, for vehicles that hover
    #[value(name = "bis")]
    Bis,
}

impl From<System> for Prime {
    fn from(system: System) -> Prime {
        match system {
            System::I => Prime::I,
            System::II => Prime::II,
            System::Bis => Prime::Bis,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_system_is_typed_by_the_name_that_tables_print() {
        for system in System::value_variants() {
            let typed = system.to_possible_value().unwrap();
            assert_eq!(typed.get_name(), Prime::from(*system).name());
        }
    }
}
