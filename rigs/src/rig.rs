//! A rig, and the tables that its file is made of.

use crate::raw::{Kind, Section, included, name, table, table_or_defaults, tables};
use crate::settings::read_limits;
use crate::target::{NoPlace, Placement};
use crate::thruster::{self, read_thrusters};
use crate::{
    Board, BollardPull, Camera, Channel, FlatPort, GreyRule, Identified, Laser, Limits,
    LogSettings, Mounts, PhysicsEntry, Tank, Target, Thruster, ThrusterSet, Tolerance, Vehicle,
};

table! {
    /// The rig itself.
    struct Head as HeadTyped {
        /// Name of the rig; it stands in logs and reports.
        pub name: String = name(),
    }
}

table! {
    /// A checked rig: everything simulator, capture, estimators and diagnosis read.
    pub struct Rig as RigTyped, checked by across_tables {
        key rig: Head = table() => |rig| Some(Head { name: rig.name.clone() }),
        /// Short name, from `[rig] name`.
        made name: String,
        /// Camera, its intrinsics and how to reach it.
        pub camera: Camera = table(),
        /// The laser sheet as it leaves its port.
        pub laser: Laser = table(),
        /// Where camera and laser sit on the body.
        pub mounts: Mounts = table(),
        /// The camera's flat port, when the rig says what it is like.
        pub port: Option<FlatPort> = table().optional(),
        /// File of the target, counted from the rig's folder, or a built-in one. Instead of `name` and `[[target.slab]]`.
        ///
        /// Target on the tank floor; `None` = bare floor.
        pub target: Option<Target> = included(|target: &mut Target, place: Placement| target.place(place)).optional(),
        /// File of the board, counted from the rig's folder, or a built-in one. Instead of all other keys.
        ///
        /// Calibration board, when the rig names one.
        pub board: Option<Board> = included(|_, _: NoPlace| {}).optional(),
        /// Thrusters, their curves and the link to their controller.
        pub thrusters: ThrusterSet = table().by_check(),
        key thruster: Vec<Thruster> = tables(thruster::MOST).by_check() => |rig| Some(rig.thrusters.thrusters.clone()),
        /// How well the thrust curve is known, where a bollard pull measured it.
        pub bollard: Option<BollardPull> = table().optional(),
        /// Mass, inertia and hydrodynamic coefficients.
        pub vehicle: Vehicle = table(),
        /// How well its coefficients are known, where an identification wrote this rig.
        pub identified: Option<Identified> = table().optional(),
        /// Tank and water.
        pub tank: Tank = table(),
        /// Where the vehicle may go during a run.
        pub limits: Limits = table().by_check(),
        /// Sizes above which a misfit is practically significant.
        pub tolerance: Tolerance = table_or_defaults(),
        /// Logging limits.
        pub log: LogSettings = table_or_defaults(),
        /// `[[physics]]`: effects that are switched on.
        pub physics: Vec<PhysicsEntry> = tables(256),
        /// The whole effective rig as TOML (includes inlined, defaults written out): what goes into the log.
        made effective_toml: String,
    }
}

fn across_tables(typed: &mut RigTyped, root: &Section<'_>) {
    typed.name = typed.rig.take().map(|head| head.name);
    typed.thrusters = read_thrusters(root);
    typed.limits = read_limits(&root.table_or_default("limits"), typed.tank.as_ref());
    typed.effective_toml = Some(String::new());
    if let (Some(vehicle), Some(tank)) = (&mut typed.vehicle, &typed.tank)
        && vehicle.stiffness[0] != 0.0
    {
        // A hull starts where it floats.
        vehicle.float_z_m = vehicle.float_z_m.or(Some(tank.start_pose[2]));
    }
    if let (Some(laser), Some(camera)) = (&typed.laser, &typed.camera)
        && laser.channel != Channel::Luma
        && !camera.pixel_format.has_colour()
    {
        root.rule(
            "laser.channel",
            format!(
                "the {} channel of a camera without colours: camera.pixel_format = \"{}\" is grey",
                laser.channel.name(),
                camera.pixel_format.name()
            ),
            "Leave out `channel`, or choose a colour format as camera.pixel_format",
        );
    }
}

impl Rig {
    /// Rule by which grey levels come out of this rig's frames.
    pub fn grey_rule(&self) -> GreyRule {
        GreyRule {
            channel: self.laser.channel,
            bits: self.camera.bits,
            yuv_range: self.camera.yuv_range.unwrap_or_default(),
        }
    }
}
