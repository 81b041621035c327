//! Laws that the library does not have: near ones (a known mechanism, another law) and unnamed ones.
//!
//! They live here only: the diagnosis must not know them.

use rand::rngs::StdRng;

use super::composed::Composed;
use super::magnitudes::{between, sign};
use super::modulated::Modulated;
use super::unsteady::Unsteady;

/// Inputs of a law.
#[derive(Debug, Clone, Copy)]
pub struct Here {
    /// Time \[s\].
    pub t_s: f64,
    /// Position \[m\].
    pub x_m: f64,
    /// Speed over ground \[m/s\].
    pub u_mps: f64,
    /// X_u, X_u|u| of the vehicle.
    pub drag: [f64; 2],
    /// Index of the run.
    pub run: usize,
    /// Load commanded \[N\].
    pub load_n: f64,
}

/// A law outside of the library.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExternalLaw {
    /// X - w tanh(X / w): a deadband without corners.
    SoftDeadband {
        /// w \[N\].
        width_n: f64,
    },
    /// X / (1 + |X / L|^6)^(1/6): a limit with a round shoulder.
    SoftSaturation {
        /// L \[N\].
        limit_n: f64,
    },
    /// Two equal first-order stages in a row.
    TwoStageLag {
        /// Sum of both time constants \[s\].
        lag_s: f64,
    },
    /// u_c = v (1 + s x): a current that varies along the tank, in the drag.
    NonUniformCurrent {
        /// v \[m/s\].
        vx_mps: f64,
        /// s \[1/m\].
        slope_per_m: f64,
    },
    /// -tanh(u / 4 mm/s) (f + rise exp(-(u / u_s)^2)).
    Stribeck {
        /// f at speed \[N\].
        f_n: f64,
        /// Further friction near rest \[N\].
        rise_n: f64,
        /// u_s \[m/s\].
        speed_mps: f64,
    },
    /// E' = |X| / 100 N s - E / tau: a battery that recovers.
    RecoveringBattery {
        /// Share lost per 100 N s.
        sag: f64,
        /// tau \[s\].
        recovery_s: f64,
    },
    /// -(k d + k2 d^2), d = max(0, x - slack): a tether that stiffens.
    StiffeningTether {
        /// k \[N/m\].
        stiffness_npm: f64,
        /// k2 \[N/m2\].
        growth_npm2: f64,
        /// Slack \[m\].
        slack_m: f64,
    },
    /// f exp(-((x - c) / w)^2): something at one place.
    PlaceBump {
        /// f \[N\].
        f_n: f64,
        /// c \[m\].
        centre_m: f64,
        /// w \[m\].
        width_m: f64,
    },
    /// f sin(2 pi x / length + phase).
    PlaceWave {
        /// f \[N\].
        f_n: f64,
        /// Length \[m\].
        length_m: f64,
        /// Phase \[rad\].
        phase_rad: f64,
    },
    /// -f sign(u) exp(-((|u| - u0) / w)^2): drag at one speed.
    SpeedBump {
        /// f \[N\].
        f_n: f64,
        /// u0 \[m/s\].
        speed_mps: f64,
        /// w \[m/s\].
        width_mps: f64,
    },
    /// f for a while, at another time in every run: someone holds the tether.
    Pull {
        /// f \[N\].
        f_n: f64,
        /// Starts per run \[s\].
        from_s: [f64; 4],
        /// Length \[s\].
        for_s: f64,
    },
    /// m (w^2 s + 2 z w (q - u)), s' = q - u, m q' = -that: a payload on a spring, or water in a tank on board.
    Slosh {
        /// m \[kg\].
        mass_kg: f64,
        /// 2 pi / w \[s\].
        period_s: f64,
        /// z.
        damping_ratio: f64,
    },
    /// Drawn by composition.
    Composed(Composed),
    /// A known mechanism one number of which varies.
    Modulated(Modulated),
    /// A disturbance that no run repeats.
    Unsteady(Unsteady),
}

/// Mechanisms with a misspecified law.
pub const NEAR: [&str; 7] = [
    "thruster_deadband",
    "thruster_lag",
    "current",
    "coulomb_friction",
    "battery_sag",
    "thruster_saturation",
    "tether_spring",
];
/// An unnamed law drawn by composition.
pub const COMPOSED: &str = "composed";
/// Kinds of unnamed laws.
pub const UNNAMED: [&str; 4] = ["place_bump", "place_wave", "speed_bump", "pull"];

impl ExternalLaw {
    /// A misspecified law of a mechanism ([`NEAR`]) at a share of its practical size; `top_n` = largest command.
    pub fn near(mechanism: &str, share: f64, top_n: f64, rng: &mut StdRng) -> Option<ExternalLaw> {
        Some(match mechanism {
            "thruster_deadband" => ExternalLaw::SoftDeadband {
                width_n: 1.2 * share,
            },
            "thruster_saturation" => ExternalLaw::SoftSaturation {
                limit_n: top_n * (1.05 - 0.5 * share),
            },
            "thruster_lag" => ExternalLaw::TwoStageLag { lag_s: 0.5 * share },
            "current" => ExternalLaw::NonUniformCurrent {
                vx_mps: 0.02 * share * sign(rng),
                slope_per_m: between(rng, 0.2, 0.6) * sign(rng),
            },
            "coulomb_friction" => {
                let f_n = 0.5 * share;
                ExternalLaw::Stribeck {
                    f_n,
                    rise_n: f_n * between(rng, 0.2, 0.6),
                    speed_mps: between(rng, 0.01, 0.03),
                }
            }
            "battery_sag" => ExternalLaw::RecoveringBattery {
                sag: 0.1 * share,
                recovery_s: between(rng, 30.0, 90.0),
            },
            "tether_spring" => {
                let stiffness_npm = 2.0 * share;
                ExternalLaw::StiffeningTether {
                    stiffness_npm,
                    growth_npm2: stiffness_npm * between(rng, 0.2, 0.6),
                    slack_m: between(rng, -0.1, 0.4),
                }
            }
            _ => return None,
        })
    }

    /// An unnamed law ([`UNNAMED`]); `reach_m` = range of x in the runs.
    pub fn unnamed(
        kind: &str,
        share: f64,
        reach_m: (f64, f64),
        rng: &mut StdRng,
    ) -> Option<ExternalLaw> {
        let f_n = 2.0 * share * sign(rng);
        let span = reach_m.1 - reach_m.0;
        Some(match kind {
            "place_bump" => ExternalLaw::PlaceBump {
                f_n,
                centre_m: reach_m.0 + span * between(rng, 0.2, 0.8),
                width_m: between(rng, 0.06, 0.15),
            },
            "place_wave" => ExternalLaw::PlaceWave {
                f_n,
                length_m: between(rng, 0.2, 0.5),
                phase_rad: between(rng, -std::f64::consts::PI, std::f64::consts::PI),
            },
            "speed_bump" => ExternalLaw::SpeedBump {
                f_n,
                speed_mps: between(rng, 0.06, 0.12),
                width_mps: between(rng, 0.01, 0.025),
            },
            "pull" => ExternalLaw::Pull {
                f_n,
                from_s: std::array::from_fn(|_| between(rng, 3.0, 17.0)),
                for_s: between(rng, 1.5, 4.0),
            },
            COMPOSED => ExternalLaw::Composed(Composed::draw(f_n, reach_m, rng)),
            _ => return None,
        })
    }

    /// Load behind the law, and the rates of its own states.
    pub fn thrust(&self, here: &Here, own: &[f64; 2], rate: &mut [f64; 2]) -> f64 {
        let load_n = here.load_n;
        match *self {
            ExternalLaw::SoftDeadband { width_n } => load_n - width_n * (load_n / width_n).tanh(),
            ExternalLaw::SoftSaturation { limit_n } => {
                load_n / (1.0 + (load_n / limit_n).abs().powi(6)).powf(1.0 / 6.0)
            }
            ExternalLaw::TwoStageLag { lag_s } => {
                rate[0] = (load_n - own[0]) / (0.5 * lag_s);
                rate[1] = (own[0] - own[1]) / (0.5 * lag_s);
                own[1]
            }
            ExternalLaw::RecoveringBattery { sag, recovery_s } => {
                let left = load_n * (1.0 - sag * own[0]).max(0.0);
                rate[0] = left.abs() / 100.0 - own[0] / recovery_s;
                left
            }
            ExternalLaw::Slosh {
                mass_kg,
                period_s,
                damping_ratio,
            } => {
                let w = std::f64::consts::TAU / period_s;
                let slip = own[1] - here.u_mps;
                let pull = w * w * own[0] + 2.0 * damping_ratio * w * slip;
                (rate[0], rate[1]) = (slip, -pull);
                load_n + mass_kg * pull
            }
            ExternalLaw::Modulated(law) => law.thrust(load_n, here),
            _ => load_n,
        }
    }

    /// Force on the hull \[N\].
    pub fn force(&self, here: &Here) -> f64 {
        match *self {
            ExternalLaw::NonUniformCurrent {
                vx_mps,
                slope_per_m,
            } => {
                let drag = |u: f64| (here.drag[0] + here.drag[1] * u.abs()) * u;
                drag(here.u_mps - vx_mps * (1.0 + slope_per_m * here.x_m)) - drag(here.u_mps)
            }
            ExternalLaw::Stribeck {
                f_n,
                rise_n,
                speed_mps,
            } => {
                -(here.u_mps / 0.004).tanh()
                    * (f_n + rise_n * (-(here.u_mps / speed_mps).powi(2)).exp())
            }
            ExternalLaw::StiffeningTether {
                stiffness_npm,
                growth_npm2,
                slack_m,
            } => {
                let d = (here.x_m - slack_m).max(0.0);
                -(stiffness_npm + growth_npm2 * d) * d
            }
            ExternalLaw::PlaceBump {
                f_n,
                centre_m,
                width_m,
            } => f_n * (-((here.x_m - centre_m) / width_m).powi(2)).exp(),
            ExternalLaw::PlaceWave {
                f_n,
                length_m,
                phase_rad,
            } => f_n * (std::f64::consts::TAU * here.x_m / length_m + phase_rad).sin(),
            ExternalLaw::SpeedBump {
                f_n,
                speed_mps,
                width_mps,
            } => {
                -f_n * here.u_mps.signum()
                    * (-((here.u_mps.abs() - speed_mps) / width_mps).powi(2)).exp()
            }
            ExternalLaw::Pull { f_n, from_s, for_s } => {
                let from = from_s[here.run.min(3)];
                if (from..from + for_s).contains(&here.t_s) {
                    f_n
                } else {
                    0.0
                }
            }
            ExternalLaw::Composed(law) => law.force(here),
            ExternalLaw::Modulated(law) => law.force(here),
            ExternalLaw::Unsteady(law) => law.force(here),
            _ => 0.0,
        }
    }

    /// Times at which the law jumps \[s\].
    pub fn jumps_s(&self, run: usize) -> Vec<f64> {
        match self {
            ExternalLaw::Pull { from_s, for_s, .. } => {
                let from = from_s[run.min(3)];
                vec![from, from + for_s]
            }
            _ => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn misspecified_laws_become_the_vocabularys_far_from_what_makes_them_soft() {
        let mut rate = [0.0; 2];
        let here = |load_n| Here {
            t_s: 0.0,
            x_m: 0.0,
            u_mps: 0.0,
            drag: [0.0; 2],
            run: 0,
            load_n,
        };
        let dead = ExternalLaw::SoftDeadband { width_n: 0.5 };
        assert!((dead.thrust(&here(8.0), &[0.0; 2], &mut rate) - 7.5).abs() < 1e-6);
        assert!(dead.thrust(&here(0.1), &[0.0; 2], &mut rate).abs() < 2e-3);
        let limit = ExternalLaw::SoftSaturation { limit_n: 6.0 };
        assert!((limit.thrust(&here(1.0), &[0.0; 2], &mut rate) - 1.0).abs() < 1e-4);
        assert!((limit.thrust(&here(-60.0), &[0.0; 2], &mut rate) + 6.0).abs() < 1e-5);
        let lag = ExternalLaw::TwoStageLag { lag_s: 0.4 };
        assert_eq!(lag.thrust(&here(5.0), &[5.0, 5.0], &mut rate), 5.0);
        assert_eq!(rate, [0.0, 0.0]);
    }

    #[test]
    fn every_listed_law_can_be_drawn_and_does_something() {
        let mut rng = StdRng::seed_from_u64(1);
        for m in NEAR {
            assert!(ExternalLaw::near(m, 0.7, 16.0, &mut rng).is_some(), "{m}");
        }
        for k in UNNAMED {
            let law = ExternalLaw::unnamed(k, 0.5, (0.0, 1.0), &mut rng).unwrap();
            let strongest = (0..4000)
                .map(|i| {
                    let here = Here {
                        t_s: f64::from(i) * 0.006,
                        x_m: f64::from(i % 100) * 0.01,
                        u_mps: f64::from(i % 37) * 0.005,
                        drag: [-20.0, -200.0],
                        run: 0,
                        load_n: 0.0,
                    };
                    law.force(&here).abs()
                })
                .fold(0.0, f64::max);
            assert!((0.7..=1.001).contains(&strongest), "{k} {strongest}");
        }
    }
}
