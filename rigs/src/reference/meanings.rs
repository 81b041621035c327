//! What each key of a file means. Units, ranges and defaults stand where the key is read.

use super::Meanings;

/// Rig files, in the order of `hydroline rig new`.
pub(super) const RIG: &[Meanings] = &[
    Meanings {
        tables: &["rig"],
        meaning: "The rig itself.",
        keys: &[("name", "Name of the rig; it stands in logs and reports.")],
    },
    Meanings {
        tables: &["camera"],
        meaning: "The camera that sees the laser line, and when its frames are true.",
        keys: &[
            (
                "backend",
                "Where frames come from: rendered by the simulator, or from a V4L2 device.",
            ),
            (
                "device",
                "Stable name of the V4L2 device, as `hydroline devices` prints it. Needed with `backend = \"v4l\"`, not allowed with `\"sim\"`.",
            ),
            (
                "allow_unstable_node",
                "Whether `device` may be a `/dev/videoN`, which can be another camera after a replug.",
            ),
            (
                "pixel_format",
                "Pixel format that the camera is asked for; `hydroline devices --long` prints what it offers.",
            ),
            (
                "bits",
                "Bits that samples of 16 bits really hold, right-aligned. Omitted: those of the pixel format.",
            ),
            (
                "yuv_range",
                "Levels of luma in YUYV, UYVY and NV12: 16 to 235 (limited) or 0 to 255 (full). Omitted: what the standard of the format says.",
            ),
            ("width_px", "Width of the image."),
            ("height_px", "Height of the image."),
            ("rate_fps", "Frame rate that the camera is asked for."),
            (
                "exposure_s",
                "Exposure time. A frame is stamped at mid-exposure. At most one frame period.",
            ),
            (
                "fov_vertical_deg",
                "Vertical field of view, of a camera with square pixels and its axis through the image centre. Instead of `fx_px`, `fy_px`, `cx_px`, `cy_px`.",
            ),
            (
                "fx_px",
                "Focal length along columns, of an intrinsic calibration; all four or none.",
            ),
            ("fy_px", "Focal length along rows."),
            (
                "cx_px",
                "Principal point, column; 0 is the centre of the top left pixel.",
            ),
            ("cy_px", "Principal point, row."),
            (
                "seed",
                "Seed of the simulated noise: the same seed gives the same frames.",
            ),
            (
                "frozen_after_s",
                "Without a frame for this long the camera counts as frozen, and the stream is restarted. At least two frame periods.",
            ),
        ],
    },
    Meanings {
        tables: &["camera.control[]"],
        meaning: "A V4L2 control to set and to lock; they are set in this order (a mode before its value). Omitted: none is set.",
        keys: &[
            (
                "name",
                "Name of the control, as `hydroline devices --long` prints it.",
            ),
            ("value", "Value that it is set to."),
        ],
    },
    Meanings {
        tables: &["camera.noise"],
        meaning: "Image formation of the simulated camera.",
        keys: &[
            (
                "blur_px",
                "Point spread of the optics: standard deviation of a Gaussian.",
            ),
            ("read_sd", "Read noise, standard deviation."),
            (
                "shot_gain",
                "Shot noise: variance per grey level of signal.",
            ),
            ("ambient", "Background light on the whole image."),
        ],
    },
    Meanings {
        tables: &["camera.response"],
        meaning: "What is known of the camera's response, g = b + 255 (L/255)^γ with L = light and g = grey level; `hydroline flat` measures it. Omitted: the first frames of each run over the target find it.",
        keys: &[
            ("gamma", "Exponent γ; 1 = the camera is linear."),
            (
                "gamma_sd",
                "Standard deviation of γ; 0 = known for certain.",
            ),
            (
                "black_levels",
                "Black level b. Omitted: one with the background; needs `black_levels_sd`.",
            ),
            (
                "black_levels_sd",
                "Standard deviation of b; needs `black_levels`.",
            ),
            (
                "gamma_black_correlation",
                "Correlation of γ and b; needs both standard deviations above 0.",
            ),
            (
                "ceiling_levels",
                "Grey level from which on light is clipped. Omitted: the frames show it themselves.",
            ),
            ("source", "Where these numbers come from, in words."),
        ],
    },
    Meanings {
        tables: &["laser"],
        meaning: "The laser sheet: a fan centred on body z.",
        keys: &[
            ("fan_deg", "Full angle of the fan."),
            (
                "sigma_m",
                "Thickness of the sheet: standard deviation of its Gaussian cross-section.",
            ),
            (
                "peak",
                "Grey level of the line on a white floor; beyond 255 it is clipped.",
            ),
            (
                "shadows",
                "Whether steps of the simulated scene cast laser shadows.",
            ),
            (
                "orientation",
                "How the line runs in the image: along rows (horizontal) only, for calibration and poses.",
            ),
            (
                "channel",
                "Channel of a colour camera that the grey levels are taken from: the laser's colour.",
            ),
        ],
    },
    Meanings {
        tables: &["mounts"],
        meaning: "Where camera and sheet sit on the body, from the centre of gravity (CG).",
        keys: &[
            ("l_laser_m", "CG to laser sheet, forward."),
            ("l_camera_m", "CG to camera, aft."),
            ("h_camera_m", "CG to camera, down."),
            (
                "h_centre_m",
                "CG to the origin (η = 0) of the sheet's coordinates, down.",
            ),
            (
                "camera_tilt_deg",
                "Tilt of the optical axis from the vertical, towards forward.",
            ),
        ],
    },
    Meanings {
        tables: &["port"],
        meaning: "The flat port before the lens, for `calibrate --method refractive`. Omitted: there is none.",
        keys: &[
            (
                "distance_m",
                "From the lens' entrance pupil to the inner face of the port.",
            ),
            ("glass_m", "Thickness of the port."),
        ],
    },
    Meanings {
        tables: &["target"],
        meaning: "What lies on the floor, written out or by `file`; `target = \"FILE\"` is the same as `file` alone. A target file has the same keys without the word target. Omitted: a bare floor.",
        keys: &[
            (
                "file",
                "Target file, counted from the rig's folder, or a built-in one. Instead of `name` and `[[target.slab]]`.",
            ),
            ("name", "Name of the target."),
            (
                "origin_m",
                "Where the target's start lies: X and Y in the tank frame. Omitted: that of the file, or [0, 0].",
            ),
            (
                "heading_deg",
                "Angle of its centre line against the tank's x axis. Omitted: that of the file, or 0.",
            ),
        ],
    },
    Meanings {
        tables: &["target.slab[]"],
        meaning: "A flat-topped part of the target: an outline in the target's frame (x along its centre line, y to starboard) and a height. At least one.",
        keys: &[
            ("name", "Name of the slab."),
            ("shape", "Its outline."),
            (
                "x0_m",
                "x of its start; of a rectangle and of a chain of hexagons.",
            ),
            ("x1_m", "x of its end; of a rectangle."),
            ("width_m", "Width across the centre line; of a rectangle."),
            ("side_m", "Side of each hexagon; of a chain of hexagons."),
            ("count", "Number of hexagons; of a chain of hexagons."),
            (
                "points_m",
                "3 to 1000 corners in order round the outline; of a polygon.",
            ),
            ("top_m", "Height of its top above the floor."),
            (
                "albedo",
                "Brightness of its top, as a factor on that of the floor.",
            ),
        ],
    },
    Meanings {
        tables: &["board"],
        meaning: "The calibration board, written out or by `file`; `board = \"FILE\"` is the same as `file` alone. A board file has the same keys without the word board. Omitted: there is none.",
        keys: &[
            (
                "file",
                "Board file, counted from the rig's folder, or a built-in one. Instead of all other keys.",
            ),
            ("name", "Name of the board."),
            (
                "pattern",
                "What marks its nodes: crossings of lines, centres of dots, or corners of a chessboard.",
            ),
            ("columns", "Number of nodes along the board's width."),
            ("rows", "Number of nodes along its height."),
            ("pitch_m", "Distance from node to node."),
            ("margin_m", "Distance from the outermost nodes to the edge."),
            ("thickness_m", "Thickness of the board."),
            (
                "line_m",
                "Width of the lines; of `pattern = \"lines\"`. Less than `pitch_m`.",
            ),
            (
                "diameter_m",
                "Diameter of the dots; of `pattern = \"dots\"`. Less than `pitch_m`.",
            ),
        ],
    },
    Meanings {
        tables: &["board.block[]"],
        meaning: "A gauge block on the board, which shows how board and laser sheet lie to each other. Omitted: there is none.",
        keys: &[
            (
                "centre_m",
                "Its centre on the board, from the board's middle.",
            ),
            ("size_m", "Its width and height on the board."),
            ("height_m", "How far it stands out from the board."),
        ],
    },
    Meanings {
        tables: &["thrusters"],
        meaning: "What all thrusters have in common.",
        keys: &[
            (
                "neutral_us",
                "Pulse width that means no thrust. Between `min_us` and `max_us`.",
            ),
            ("min_us", "Least pulse width: none below goes out."),
            ("max_us", "Largest pulse width: none above goes out."),
            (
                "max_slew_us_per_s",
                "Largest rate of change of a pulse width.",
            ),
            (
                "curve",
                "Thrust over pulse width, linear between the points, of every `[[thruster]]` without a curve of its own.",
            ),
        ],
    },
    Meanings {
        tables: &["thrusters.link"],
        meaning: "The link to the thruster controller.",
        keys: &[
            (
                "kind",
                "Protocol: hydroline's own, with the controller's clock in every echo, or that of a Pololu Maestro.",
            ),
            (
                "port",
                "Serial adapter by its stable name, as `hydroline devices` prints it, or the simulated controller.",
            ),
            (
                "allow_unstable_node",
                "Whether `port` may be a `/dev/ttyX`, which can be another adapter after a replug.",
            ),
            (
                "baud",
                "Bit rate of the line. It must carry all thrusters at `rate_hz`.",
            ),
            (
                "rate_hz",
                "Rate of the commands; between two of them the last one holds.",
            ),
            (
                "deadline_s",
                "A command that is later than this is not sent: the thrusters go to neutral.",
            ),
            (
                "timeout_s",
                "Without an answer of the controller for this long the thrusters go to neutral.",
            ),
        ],
    },
    Meanings {
        tables: &["thruster[]"],
        meaning: "A thruster. At least one, at most 24.",
        keys: &[
            ("name", "Name of the thruster; each its own."),
            ("channel", "Channel of the controller; each its own."),
            ("position_m", "Position in the body frame, from the CG."),
            (
                "direction",
                "Direction of positive thrust in the body frame: a unit vector.",
            ),
            ("curve", "Thrust over pulse width of this thruster."),
        ],
    },
    Meanings {
        tables: &["bollard"],
        meaning: "Covariance of the thrust curve, as `identify --bollard --write-rig` writes it. Omitted: the curve is taken as exact.",
        keys: &[
            (
                "voltage_v",
                "Supply voltage that the curve holds at; 0 = not measured.",
            ),
            (
                "scatter_n",
                "Standard deviation of the readings about the curve.",
            ),
            ("pulse_us", "Pulse widths of the curve's points."),
            (
                "covariance_n2",
                "Covariance of their thrusts, one row per pulse.",
            ),
        ],
    },
    Meanings {
        tables: &["vehicle"],
        meaning: "The vehicle's equations of motion.",
        keys: &[
            (
                "model",
                "Equations: Eq. 1 of the paper with its Coriolis terms, or six independent equations of one degree of freedom.",
            ),
            ("mass_kg", "Mass."),
            (
                "inertia_kgm2",
                "Moments of inertia I_x, I_y, I_z about the CG.",
            ),
            (
                "r_bz_m",
                "Centre of buoyancy from the CG, z down: negative = above = stable.",
            ),
            ("gravity_mps2", "Gravitational acceleration."),
        ],
    },
    Meanings {
        tables: &["vehicle.surge", "vehicle.sway", "vehicle.heave"],
        meaning: "Hydrodynamic coefficients of the translations, SNAME signs: negative for a real hull.",
        keys: &[
            ("added_kg", "Added mass: X_udot, Y_vdot, Z_wdot."),
            ("linear_kgps", "Linear damping: X_u, Y_v, Z_w."),
            (
                "quadratic_kgpm",
                "Quadratic damping: X_u|u|, Y_v|v|, Z_w|w|.",
            ),
        ],
    },
    Meanings {
        tables: &["vehicle.roll", "vehicle.pitch", "vehicle.yaw"],
        meaning: "Hydrodynamic coefficients of the rotations, SNAME signs: negative for a real hull.",
        keys: &[
            (
                "added_kgm2",
                "Added moment of inertia: K_pdot, M_qdot, N_rdot.",
            ),
            ("linear_kgm2ps", "Linear damping: K_p, M_q, N_r."),
            (
                "quadratic_kgm2",
                "Quadratic damping: K_p|p|, M_q|q|, N_r|r|.",
            ),
        ],
    },
    Meanings {
        tables: &["identified"],
        meaning: "Coefficients with their covariance, as `identify --write-rig` writes them: `predict` makes its band of it. Omitted: coefficients carry no uncertainty.",
        keys: &[
            (
                "coefficients",
                "Names of the coefficients, in the order of the other lists.",
            ),
            ("values", "Their values."),
            (
                "sd",
                "Their standard deviations: the roots of the covariance's diagonal.",
            ),
            ("covariance", "Their covariance, one row per coefficient."),
        ],
    },
    Meanings {
        tables: &["tank"],
        meaning: "The tank, and where the vehicle starts; tank frame, z down, 0 on the floor.",
        keys: &[
            (
                "n_water",
                "Refractive index in front of the camera: 1.333 fresh water, 1.340 sea water, 1.0 = no water and no port.",
            ),
            ("x_m", "Walls along x: from, to."),
            ("y_m", "Walls along y: from, to."),
            ("depth_m", "Depth of the water."),
            (
                "start_m",
                "Position of the CG at the start; within the water.",
            ),
            ("start_attitude_deg", "Roll, pitch and yaw at the start."),
        ],
    },
    Meanings {
        tables: &["limits"],
        meaning: "Where the CG may go. A plan that leaves it is refused before it starts; a run that leaves it goes to neutral and ends.",
        keys: &[
            (
                "x_m",
                "Allowed x: from, to; within the tank, the start within it.",
            ),
            ("y_m", "Allowed y: from, to."),
            ("z_m", "Allowed z: from, to."),
            ("attitude_deg", "Largest size of roll and of pitch."),
        ],
    },
    Meanings {
        tables: &["physics[]"],
        meaning: "An effect beyond the vehicle's equations, and its parameters as further keys: [Effects](effects.md) lists them. Omitted: none.",
        keys: &[("effect", "Id of the effect.")],
    },
    Meanings {
        tables: &["tolerance"],
        meaning: "What size of misfit (root mean square) is practically significant.",
        keys: &[
            ("position_m", "Of a position."),
            ("attitude_deg", "Of an angle."),
            ("speed_mps", "Of a speed."),
            ("rate_radps", "Of an angular rate."),
        ],
    },
    Meanings {
        tables: &["log"],
        meaning: "What the log may use.",
        keys: &[
            (
                "queue_bytes",
                "Size of the queue between capture and writer; beyond it new frames are dropped and counted.",
            ),
            (
                "chunk_bytes",
                "Largest size of a chunk of the file; at most `queue_bytes`.",
            ),
            ("chunk_age_s", "Longest time for which a chunk stays open."),
            (
                "command_flush_s",
                "Longest time for which a command or an event waits in an open chunk.",
            ),
            ("sync_s", "Interval between calls of fdatasync."),
            (
                "rotate_bytes",
                "Size from which on the log goes on in a new file; 0 = never, else at least 16 chunks.",
            ),
            (
                "min_free_bytes",
                "Room that is left on the disk: with less the log is closed and the run ends.",
            ),
            (
                "zstd_level",
                "Compression level of zstd; 0 = no compression.",
            ),
        ],
    },
];

/// Plan files.
pub(super) const PLAN: &[Meanings] = &[
    Meanings {
        tables: &[""],
        meaning: "Before all tables.",
        keys: &[("name", "Name of the plan.")],
    },
    Meanings {
        tables: &["step[]"],
        meaning: "A step: a load that the thrusters make for a time. At least one; each has `wrench` or `thrust_n`.",
        keys: &[
            ("for_s", "How long the step lasts."),
            (
                "shape",
                "How the load goes over the step: constant, in a line from that of the step before, as a sine, or as a sine of rising or falling frequency.",
            ),
            ("period_s", "Period; of `shape = \"sine\"`."),
            (
                "phase_deg",
                "Phase at the step's begin; of `shape = \"sine\"`. Omitted: 0.",
            ),
            (
                "f0_hz",
                "Frequency at the step's begin; of `shape = \"chirp\"`.",
            ),
            ("f1_hz", "Frequency at its end; of `shape = \"chirp\"`."),
        ],
    },
    Meanings {
        tables: &["step[].wrench"],
        meaning: "Load on the body, in the body frame about the CG; what is omitted is 0, `wrench = {}` is a pause.",
        keys: &[
            ("surge_n", "Force forward."),
            ("sway_n", "Force to starboard."),
            ("heave_n", "Force down."),
            ("roll_nm", "Moment about x, starboard side down."),
            ("pitch_nm", "Moment about y, bow up."),
            ("yaw_nm", "Moment about z, bow to starboard."),
        ],
    },
    Meanings {
        tables: &["step[].thrust_n"],
        meaning: "Thrust in N of single thrusters, by their names in the rig; those omitted are at 0.",
        keys: &[],
    },
];
