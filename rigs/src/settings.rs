//! Tank, tolerance and logging settings.

/// The tank and the start of a simulated run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tank {
    /// Refractive index of the water (1.0 = the paper's ideal air-like camera).
    pub n_water: f64,
    /// Start pose of the CG in the tank frame: x, y, z \[m\], phi, theta, psi \[rad\] (z = -0.83: 0.83 m above the floor).
    pub start_pose: [f64; 6],
    /// Walls across x, tank frame \[m\].
    pub x_m: [f64; 2],
    /// Walls across y, tank frame \[m\].
    pub y_m: [f64; 2],
    /// Water depth: the surface is at z = -depth \[m\].
    pub depth_m: f64,
}

/// Where the CG may go during a run (`[limits]`): a plan that leaves it is refused, a
/// run that leaves it goes to neutral. Default: the tank itself and 30 deg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lowest and highest x, tank frame \[m\].
    pub x_m: [f64; 2],
    /// Lowest and highest y, tank frame \[m\].
    pub y_m: [f64; 2],
    /// Lowest and highest z (down), tank frame \[m\].
    pub z_m: [f64; 2],
    /// Largest |roll| and |pitch| \[rad\].
    pub attitude_rad: f64,
}

/// What size of misfit matters (`[tolerance]`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Position, rms \[m\] (default 2 mm).
    pub position_m: f64,
    /// Attitude, rms \[rad\] (default 0.1 deg).
    pub attitude_rad: f64,
    /// Velocity, rms \[m/s\] (default 2 mm/s).
    pub speed_mps: f64,
    /// Rate of attitude, rms \[rad/s\] (default 0.1 deg/s).
    pub rate_radps: f64,
}

impl Tolerance {
    /// Of each channel: position, attitude, velocity, rate.
    pub fn channels(&self) -> [f64; 12] {
        std::array::from_fn(|c| match c {
            0..3 => self.position_m,
            3..6 => self.attitude_rad,
            6..9 => self.speed_mps,
            _ => self.rate_radps,
        })
    }
}

/// Logging limits (`[log]`), with their defaults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogSettings {
    /// Bytes the queue between capture and writer may hold (256 MiB).
    pub queue_bytes: u64,
    /// Largest chunk \[bytes\] (1 MiB).
    pub chunk_bytes: u64,
    /// Oldest open chunk \[s\] (1 s).
    pub chunk_age_s: f64,
    /// A command or event may wait this long in an open chunk \[s\] (0.04 s).
    pub command_flush_s: f64,
    /// Interval between fdatasync calls \[s\] (2 s).
    pub sync_s: f64,
    /// Start a new file beyond this size \[bytes\]; 0 = never.
    pub rotate_bytes: u64,
    /// Stop cleanly when the disk has less than this left \[bytes\].
    pub min_free_bytes: u64,
    /// zstd level of the chunks; 0 = no compression.
    pub zstd_level: u32,
}
