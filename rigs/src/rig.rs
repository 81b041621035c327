use crate::{
    BollardPull, Camera, FlatPort, GreyRule, Identified, Laser, Limits, LogSettings, Mounts,
    PhysicsEntry, Tank, Target, ThrusterSet, Tolerance, Vehicle, target::Board,
};

/// A checked rig: everything simulator, capture, estimators and diagnosis read.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// Short name, from `[rig] name`.
    pub name: String,
    /// Camera, its intrinsics and how to reach it.
    pub camera: Camera,
    /// The laser sheet as it leaves its port.
    pub laser: Laser,
    /// Where camera and laser sit on the body.
    pub mounts: Mounts,
    /// The camera's flat port, when the rig says what it is like.
    pub port: Option<FlatPort>,
    /// What lies on the tank floor; `None` = bare floor.
    pub target: Option<Target>,
    /// Calibration board, when the rig names one.
    pub board: Option<Board>,
    /// Thrusters, their curves and the link to their controller.
    pub thrusters: ThrusterSet,
    /// How well the thrust curve is known, where a bollard pull measured it.
    pub bollard: Option<BollardPull>,
    /// Mass, inertia and hydrodynamic coefficients.
    pub vehicle: Vehicle,
    /// How well its coefficients are known, where an identification wrote this rig.
    pub identified: Option<Identified>,
    /// Tank and water.
    pub tank: Tank,
    /// Where the vehicle may go during a run.
    pub limits: Limits,
    /// `[[physics]]`: effects that are switched on.
    pub physics: Vec<PhysicsEntry>,
    /// What size of misfit matters.
    pub tolerance: Tolerance,
    /// Logging limits.
    pub log: LogSettings,
    /// The whole effective rig as TOML (includes inlined, defaults written out): what goes into the log.
    pub effective_toml: String,
}

impl Rig {
    /// How grey levels come out of this rig's frames.
    pub fn grey_rule(&self) -> GreyRule {
        GreyRule {
            channel: self.laser.channel,
            bits: self.camera.bits,
            yuv_range: self.camera.yuv_range.unwrap_or_default(),
        }
    }

    /// The rig as it is now as TOML: every include inlined, every default said. Reads back to the same rig.
    pub fn to_toml(&self) -> String {
        crate::effective::rig(self)
    }
}
