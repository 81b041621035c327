//! Limits while running: which estimate, against which range, and when it is an abort.
//!
//! A core without I/O: estimates in, verdict out. One outlier is not an abort (a particle in the
//! laser line is enough for one); [`CONFIRM`] estimates in a row are.

use hydroline_rigs::Limits;

/// Estimates in a row beyond a limit that make an abort: 3 frames = 0.12 s at 25 fps, in which a
/// vehicle at 0.2 m/s travels 24 mm.
pub const CONFIRM: u32 = 3;

/// Pose estimate for the limits; `None` = not measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Along the tank, tank frame \[m\].
    pub x_m: Option<f64>,
    /// Across the tank, tank frame \[m\].
    pub y_m: Option<f64>,
    /// Depth coordinate of the CG, tank frame, z down from the floor (negative above it) \[m\].
    pub z_m: Option<f64>,
    /// Roll \[rad\].
    pub phi_rad: Option<f64>,
    /// Pitch \[rad\].
    pub theta_rad: Option<f64>,
}

/// Watches estimates against a rig's `[limits]`.
#[derive(Debug, Clone)]
pub struct LimitMonitor {
    limits: Limits,
    beyond: [u32; 5],
}

impl LimitMonitor {
    /// A monitor that has seen nothing yet.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            beyond: [0; 5],
        }
    }

    /// Takes one estimate; `Some(words)` when a limit was passed [`CONFIRM`] times in a row.
    pub fn update(&mut self, estimate: &Estimate) -> Option<String> {
        let attitude = [-self.limits.attitude_rad, self.limits.attitude_rad];
        let channels = [
            ("x", estimate.x_m, self.limits.x_m, "m"),
            ("y", estimate.y_m, self.limits.y_m, "m"),
            ("z", estimate.z_m, self.limits.z_m, "m"),
            ("roll", estimate.phi_rad, attitude, "rad"),
            ("pitch", estimate.theta_rad, attitude, "rad"),
        ];
        for (count, (name, value, range, unit)) in self.beyond.iter_mut().zip(channels) {
            // Not measured: keep the count; a lost stripe must not clear a building alarm.
            let Some(value) = value else { continue };
            let [low, high] = range;
            if (low..=high).contains(&value) {
                *count = 0;
            } else {
                *count += 1;
                if *count >= CONFIRM {
                    return Some(format!(
                        "{name} = {value:.3} {unit} is outside the rig's [limits] {low:.3} .. {high:.3} {unit}"
                    ));
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn monitor() -> LimitMonitor {
        LimitMonitor::new(Limits {
            x_m: [-0.1, 1.5],
            y_m: [-1.0, 1.0],
            z_m: [-1.0, -0.5],
            attitude_rad: 0.3,
        })
    }

    fn at_z(z_m: f64) -> Estimate {
        Estimate {
            z_m: Some(z_m),
            ..Estimate::default()
        }
    }

    #[test]
    fn one_outlier_is_no_abort_but_three_in_a_row_are() {
        let mut monitor = monitor();
        for z in [-0.8, -0.2, -0.8, -0.2, -0.2] {
            assert_eq!(monitor.update(&at_z(z)), None);
        }
        let words = monitor.update(&at_z(-0.2)).unwrap();
        assert!(
            words.contains("z = -0.200 m") && words.contains("-1.000 .. -0.500"),
            "{words}"
        );
    }

    #[test]
    fn a_frame_without_a_stripe_does_not_clear_the_alarm() {
        let mut monitor = monitor();
        monitor.update(&at_z(-0.2));
        monitor.update(&at_z(-0.2));
        assert_eq!(monitor.update(&Estimate::default()), None);
        assert!(monitor.update(&at_z(-0.2)).is_some());
    }

    #[test]
    fn roll_counts_on_both_sides_and_nan_counts_as_beyond() {
        let mut monitor = monitor();
        for phi in [-0.31, 0.31] {
            monitor.update(&Estimate {
                phi_rad: Some(phi),
                ..Estimate::default()
            });
        }
        assert!(
            monitor
                .update(&Estimate {
                    phi_rad: Some(-0.4),
                    ..Estimate::default()
                })
                .is_some()
        );
        let nan = Estimate {
            x_m: Some(f64::NAN),
            ..Estimate::default()
        };
        monitor.update(&nan);
        monitor.update(&nan);
        assert!(monitor.update(&nan).is_some());
    }
}
