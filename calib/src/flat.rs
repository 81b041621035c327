//! A camera's response from an exposure series of a scene that stands still.
//!
//! With g = b + k (t E)^γ each pixel p under exposure time t_j shows g_jp = b + s_j y_p, where y_p = k E_p^γ is its own and
//! s_j = t_j^γ is the exposure's. So the levels of two exposures are a straight line of each other whatever the scene is,
//! and nothing but such a curve makes them one (the ratio method: Mann and Picard 1995; Mitsunaga and Nayar 1999; scene
//! free per pixel: Debevec and Malik 1997). In two steps:
//!
//! 1. [`ratios`]: b and ln s_j from the levels, each place's y_p free, and a smooth deviation d(g) from the curve, whose size
//!    is found with them: what is left of it widens all that follows, and where it is large the curve is no power.
//! 2. [`power`]: γ as the slope of ln s_j over ln t_j, with a scatter of the exposures (lamp, exposure clock) that is found too.
//!
//! Places are blocks of pixels ([`exposure`]): one that is clipped anywhere is discarded whole.

mod black;
mod exposure;
mod power;
mod ratios;
mod steady;

pub use exposure::Exposure;
pub use steady::Unsteady;

use hydroline_rigs::StatedResponse;

/// Requirements on an exposure series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Fewer frames of an exposure do not determine its noise.
    pub frames_least: usize,
    /// Fewer exposures cannot contradict each other.
    pub exposures_least: usize,
    /// A pixel this many sds of its noise from floor or ceiling is not cut off by them in one frame of 10⁴.
    pub clear_sds: f64,
    /// Light less than so many of its own sds above none shifts its mean by more than the second order that is taken off.
    pub light_sds: f64,
    /// Levels that the blocks that are used must span: a power and a straight line differ by a tenth of that.
    pub span_least_levels: f64,
    /// Blocks that must be seen under two exposures or more.
    pub blocks_least: usize,
    /// A smooth deviation from the curve larger than this makes poses that are off by more than γ's sd implies.
    pub deviation_most_levels: f64,
    /// Of the blocks as many may change between exposures; more is a scene that moves.
    pub moved_most_share: f64,
    /// Scatter of the exposures about their times beyond which light or gain is not what is stated.
    pub scatter_most: f64,
    /// Frames of one exposure may differ in brightness by this.
    pub flicker_most: f64,
    /// γ known worse than this is not known better than from a run's first frames.
    pub gamma_sd_most: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            frames_least: 3,
            exposures_least: 3,
            clear_sds: 4.0,
            light_sds: 8.0,
            span_least_levels: 60.0,
            blocks_least: 50,
            deviation_most_levels: 0.5,
            moved_most_share: 0.2,
            scatter_most: 0.05,
            flicker_most: 0.2,
            gamma_sd_most: 0.1,
        }
    }
}

/// The result of an exposure series.
#[derive(Debug, Clone, PartialEq)]
pub struct Flat {
    /// γ and its sd.
    pub gamma: [f64; 2],
    /// b and its sd \[grey levels\].
    pub black_levels: [f64; 2],
    /// Their correlation.
    pub correlation: f64,
    /// Level from which on light is clipped, where some is.
    pub ceiling_levels: Option<u8>,
    /// Levels between which the curve was looked at \[grey levels\].
    pub levels: [f64; 2],
    /// Smooth deviation from the curve, rms \[grey levels\], and the level where it is largest.
    pub deviation: Deviation,
    /// Scatter of the exposures about their times, share of the light.
    pub scatter: f64,
    /// χ² per degree of freedom of the blocks about the curve.
    pub chi2: f64,
    /// Blocks used, and those discarded since they changed.
    pub blocks: [usize; 2],
    /// Share by which each exposure that was used is brighter than by its exposure time, by name.
    pub off_times: Vec<(String, f64)>,
    /// Remarks for the user, e.g. an exposure that was left out.
    pub remarks: Vec<String>,
}

/// Deviation of the levels from a power of light.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Deviation {
    /// Root mean square over the levels \[grey levels\].
    pub rms_levels: f64,
    /// Largest size \[grey levels\].
    pub most_levels: f64,
    /// Level where that is \[grey levels\].
    pub at_levels: f64,
    /// χ² of having any, and its degrees of freedom.
    pub chi2: [f64; 2],
}

/// Why a series gives no result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum FlatError {
    #[error(
        "{exposures} exposures of different times; at least {least} are needed: fewer cannot contradict each other. Record the same scene at 5 to 8 exposure times, each twice the one before"
    )]
    FewExposures { exposures: usize, least: usize },
    #[error(
        "{name}: {frames} frames; at least {least} of each exposure are needed to tell the noise, 10 to 20 are better"
    )]
    FewFrames {
        name: String,
        frames: usize,
        least: usize,
    },
    #[error(
        "{name}: a frame of {got:?} pixels, others have {wanted:?}; all must be of one camera at one size"
    )]
    Size {
        name: String,
        got: (usize, usize),
        wanted: (usize, usize),
    },
    #[error("{name}: {what}")]
    Unsteady { name: String, what: Unsteady },
    #[error(
        "{blocks} places of the picture are seen between floor and ceiling under two exposures or more, over {span:.0} grey levels; {blocks_least} over {span_least:.0} are needed: choose a scene of many brightnesses, exposures that reach from dark to clipped, each at most three times the one before"
    )]
    Little {
        blocks: usize,
        blocks_least: usize,
        span: f64,
        span_least: f64,
    },
    #[error(
        "{name}: no place of the picture is between floor and ceiling both here and under another exposure: choose exposure times nearer to each other, or leave it out"
    )]
    Apart { name: String },
    #[error(
        "{:.0} % of the picture changed between exposures by more than its noise (at most {:.0} % may): camera, scene or light moved. Fix the camera, keep people and reflections out, and record again", 100.0 * share, 100.0 * most
    )]
    Moved { share: f64, most: f64 },
    #[error(
        "{name}: light is {:+.0} % off what its exposure time says beside the others (at most {:.0} % may be): auto exposure, auto gain or auto white balance is on, the lamp changed, or the time is wrong. Set the camera's controls to manual, or leave this exposure out", 100.0 * share, 100.0 * most
    )]
    OffTime { name: String, share: f64, most: f64 },
    #[error(
        "grey levels follow the exposure time by a power of about {gamma:.2}; cameras have 0.2 to 5: auto exposure or auto gain is on, or the times are wrong. Set the camera's controls to manual and record again"
    )]
    NoCamera { gamma: f64 },
    #[error(
        "the camera's curve is no power of light: it deviates by {:.2} grey levels rms between {:.0} and {:.0}, by {:+.2} at {:.0} (chi2 {:.0} of {:.0}; at most {most:.1} rms may be). Switch off contrast, dynamic range and tone curve controls (`hydroline devices --long` lists them), and record again; without [camera.response] each run's first frames find the nearest power", deviation.rms_levels, levels[0], levels[1], deviation.most_levels, deviation.at_levels, deviation.chi2[0], deviation.chi2[1]
    )]
    NoPower {
        deviation: Deviation,
        levels: [f64; 2],
        most: f64,
    },
    #[error(
        "gamma comes out as {gamma:.3} with a standard deviation of {sd:.3}, worse than the first frames of a run tell it ({most}): give more exposures over a larger range of times, more frames, and a scene of more brightnesses"
    )]
    Vague { gamma: f64, sd: f64, most: f64 },
    #[error(
        "the exposures do not determine the curve, their levels hardly differ: is auto exposure on (set the camera's controls to manual)? Else choose a scene of many brightnesses and exposure times over a range of 10 or more"
    )]
    Undetermined,
}

impl Flat {
    /// The response as a rig states it.
    pub fn stated(&self, source: String) -> StatedResponse {
        // As many digits as the sds have meaning for.
        let digits = |value: f64, sd: f64| {
            let place = 10f64.powf((sd.max(1e-6).log10()).floor() - 2.0);
            (value / place).round() * place
        };
        let tidy =
            |value: f64, sd: f64| format!("{:.6}", digits(value, sd)).parse().unwrap_or(value);
        let [gamma, gamma_sd] = self.gamma;
        let [black, black_sd] = self.black_levels;
        StatedResponse {
            gamma: tidy(gamma, gamma_sd),
            gamma_sd: tidy(gamma_sd, gamma_sd).max(1e-6),
            black_levels: Some([tidy(black, black_sd), tidy(black_sd, black_sd).max(1e-6)]),
            gamma_black_correlation: tidy(self.correlation.clamp(-0.999, 0.999), 0.1),
            ceiling_levels: self.ceiling_levels,
            source,
        }
    }
}

/// Where a toe or a knee may end: levels of the floor's and the ceiling's end that are discarded where the curve is no power
/// there. sRGB is straight below 10, BT.709 below 21; knees of cameras begin at 80 to 90 % of full.
const ENDS: [[f64; 2]; 7] = [
    [0.0, 255.0],
    [12.0, 255.0],
    [0.0, 225.0],
    [24.0, 255.0],
    [12.0, 225.0],
    [24.0, 225.0],
    [36.0, 205.0],
];

/// The response that a series shows; `dark` = frames with the lens covered.
///
/// # Errors
/// [`FlatError`] with what to do.
pub fn response(
    exposures: &[Exposure],
    dark: Option<&Exposure>,
    options: &Options,
) -> Result<Flat, FlatError> {
    let mut remarks = Vec::new();
    let mut used: Vec<&Exposure> = exposures.iter().collect();
    exposure::check(&used, dark, options)?;
    loop {
        match of_used(&used, dark, options, remarks.clone()) {
            // It shows nothing between floor and ceiling: a series is to reach beyond both.
            Err(FlatError::Apart { name }) if used.len() > options.exposures_least => {
                remarks.push(format!(
                    "{name}: no place of the picture is between floor and ceiling both here and under another exposure; it is left out"
                ));
                used.retain(|e| e.name != name);
                exposure::check(&used, dark, options)?;
            }
            concluded => return concluded,
        }
    }
}

fn of_used(
    exposures: &[&Exposure],
    dark: Option<&Exposure>,
    options: &Options,
    mut remarks: Vec<String>,
) -> Result<Flat, FlatError> {
    let noise = exposure::Noise::of(exposures);
    let steadiness = steady::all(exposures, &noise, options, &mut remarks)?;
    let field = exposure::Field::of(exposures, &steadiness, noise);
    let times: Vec<(String, f64)> = exposures
        .iter()
        .map(|e| (e.name.clone(), e.time_s))
        .collect();
    let mut refused = None;
    for ends in ENDS {
        match ratios::fit(&field, &times, ends, options) {
            Ok(found) if found.deviation.rms_levels <= options.deviation_most_levels => {
                if ends != ENDS[0] {
                    remarks.push(format!(
                        "the curve is a power of light between {:.0} and {:.0} grey levels only: keep the background above and the line below",
                        found.levels[0], found.levels[1]
                    ));
                }
                return concluded(exposures, dark, &field, found, options, remarks);
            }
            Ok(found) => {
                refused.get_or_insert(FlatError::NoPower {
                    deviation: found.deviation,
                    levels: found.levels,
                    most: options.deviation_most_levels,
                });
            }
            // With ends discarded too little is left: the reason is why they were.
            Err(error) => return Err(refused.unwrap_or(error)),
        }
    }
    Err(refused.unwrap_or(FlatError::Undetermined))
}

fn concluded(
    exposures: &[&Exposure],
    dark: Option<&Exposure>,
    field: &exposure::Field,
    found: ratios::Ratios,
    options: &Options,
    mut remarks: Vec<String>,
) -> Result<Flat, FlatError> {
    let mut curve = power::fit(exposures, field, &found, options)?;
    if let Some(dark) = dark {
        remarks.push(black::with_dark(&mut curve, dark, field));
    }
    let [gamma, gamma_sd] = [curve.gamma(), curve.covariance[(0, 0)].sqrt()];
    if gamma_sd > options.gamma_sd_most * gamma.max(1.0) {
        return Err(FlatError::Vague {
            gamma,
            sd: gamma_sd,
            most: options.gamma_sd_most,
        });
    }
    if field.ceiling.is_none() {
        remarks.push(
            "no exposure clips light: the level at which the camera does is left to the frames of a run; add a longer exposure"
                .to_owned(),
        );
    }
    let black_sd = curve.covariance[(1, 1)].sqrt();
    Ok(Flat {
        gamma: [gamma, gamma_sd],
        black_levels: [curve.mean[1], black_sd],
        correlation: curve.covariance[(0, 1)] / (gamma_sd * black_sd),
        ceiling_levels: field.ceiling,
        levels: found.levels,
        deviation: found.deviation,
        scatter: curve.scatter,
        chi2: found.chi2,
        blocks: found.blocks,
        off_times: {
            let names = exposures.iter().map(|e| e.name.clone());
            names.zip(curve.off_times).collect()
        },
        remarks,
    })
}

#[cfg(test)]
mod tests;
