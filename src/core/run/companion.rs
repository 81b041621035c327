//! Companions measured beside the motion: angles of rudder and fins, shaft speed, height of the waves.

/// Names of the companions, with their units.
pub const COMPANIONS: [&str; 4] = ["rudder_rad", "elevator_rad", "shaft_radps", "wave_m"];

/// Companions over time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Companions {
    /// Stamps \[s since the log's first stamp\], ascending.
    pub times_s: Vec<f64>,
    /// In the order of [`COMPANIONS`]; NaN = not measured.
    pub values: Vec<[f64; COMPANIONS.len()]>,
}

impl Companions {
    /// Takes what was measured at a time, if anything was.
    pub fn push(&mut self, t_s: f64, values: [f64; COMPANIONS.len()]) {
        if values.iter().any(|v| v.is_finite()) {
            self.times_s.push(t_s);
            self.values.push(values);
        }
    }

    /// Those within `from_s ..= to_s`.
    #[must_use]
    pub fn between(&self, from_s: f64, to_s: f64) -> Companions {
        let from = self.times_s.partition_point(|t_s| *t_s < from_s);
        let to = self.times_s.partition_point(|t_s| *t_s <= to_s).max(from);
        Companions {
            times_s: self.times_s[from..to].to_vec(),
            values: self.values[from..to].to_vec(),
        }
    }

    /// One companion where it was measured: stamps \[s\] and values.
    pub fn measured(&self, companion: usize) -> (Vec<f64>, Vec<f64>) {
        let each = self.times_s.iter().zip(&self.values);
        each.map(|(t_s, v)| (*t_s, v[companion]))
            .filter(|(_, v)| v.is_finite())
            .unzip()
    }
}
