//! Settings of the look at the light: each number with its reason.

/// Options of the light level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightOptions {
    /// Frames read at most: light is the same in all, and a handful shows it to a thousandth.
    pub frames: usize,
    /// Fewest frames that are asked.
    pub frames_least: usize,
    /// Columns pooled across the stripe \[px\]: its rows run straight over as many.
    pub columns: usize,
    /// Half the height of what is read row by row \[px\]: four sds of the widest stripe of these rigs.
    pub near_rows: i64,
    /// Ends of the classes of rows farther off \[px\]: haze fades over tens of rows, so they may grow.
    pub far_rows: [i64; 7],
    /// A block of background \[px\]: columns, rows. A lamp's bands are a hundred rows high.
    pub block_px: [usize; 2],
    /// sd of ln(sheet's thickness over the rig's), as for the profiles.
    pub thickness_ln: f64,
    /// sd of ln(point spread's variance over the rig's), as for the profiles.
    pub spread_ln: f64,
    /// sd of how fast surfaces rise ahead in a frame, a tangent: most vehicles pitch by a few degrees, but in a run of pitch by
    /// twenty (Table 3 of the paper), and poses are not known yet.
    pub rise: f64,
    /// sd of ln(read noise over the rig's): cameras are warmer and colder than their data sheet.
    pub noise_ln: f64,
    /// sd of skewness and excess of the stripe's profile: no beam is a Gaussian to better than a per cent.
    pub shape: f64,
    /// sd of a frame's ln(brightness over the rig's).
    pub brightness_ln: f64,
    /// sd of a frame's background about the rig's \[grey levels\].
    pub background_grey: f64,
    /// Span within which the lamps' phase of a frame is looked for \[s\]: no mains is slower than 50 Hz, and lamps flicker
    /// at twice that. Frame clocks and mains drift by turns within a run, so that a frame's phase is its own.
    pub lamp_s: f64,
    /// sd of a stripe point's row: the extractor's, and what haze pulls it by \[px\].
    pub row_px: f64,
    /// sd of the brightness of some columns: paint and print are even to a per cent.
    pub paint: f64,
    /// sd of the same on targets that are not all as bright as the floor.
    pub paint_uneven: f64,
    /// Median of the gain field without a name: as even as light and print are without any cause.
    pub gain: f64,
    /// Median of the background's field without a name \[grey levels\].
    pub ambient_grey: f64,
    /// Spread beyond the noise of samples across the stripe, over the stripe's brightness, to begin with.
    pub floor: f64,
    /// The same of the background \[grey levels\].
    pub floor_grey: f64,
    /// Share of samples that are something else, and their range \[grey levels\].
    pub stray: (f64, f64),
    /// Change of a sample from which an effect is said to light the picture \[grey levels\]: a camera has whole ones.
    pub lights_grey: f64,
    /// Samples that a fit takes at most: bins across the stripe, blocks of background. These show a lens' shading to a
    /// hundredth of its usual size.
    pub most: [usize; 2],
    /// The same of a first look.
    pub few: [usize; 2],
    /// Steps of a first look, and of a fit.
    pub steps: (usize, usize),
    /// Gain of a step below which a fit has settled \[nat\].
    pub settled: f64,
    /// Additions that are fitted after a first look.
    pub additions: usize,
    /// The same in the place of an effect.
    pub swaps: usize,
    /// Effects of a model at most.
    pub effects: usize,
    /// Gain of log score below which a way is not followed: one in a hundred \[nat\].
    pub worth: f64,
    /// rms of the field without a name from which it is said: gain, background \[grey levels\]. Below that the camera's
    /// noise and the print of the target are as large.
    pub unnamed: (f64, f64),
    /// Share of strays among the samples of background or stripe from which something else is in the picture: twice what
    /// every model allows for.
    pub strays: f64,
}

impl Default for LightOptions {
    fn default() -> Self {
        LightOptions {
            frames: 12,
            frames_least: 2,
            columns: 12,
            near_rows: 10,
            far_rows: [13, 17, 22, 29, 38, 50, 66],
            block_px: [120, 8],
            thickness_ln: 0.1,
            spread_ln: 0.4,
            rise: 0.2,
            noise_ln: 0.5,
            shape: 0.005,
            brightness_ln: 0.5,
            background_grey: 30.0,
            lamp_s: 0.01,
            row_px: 0.1,
            paint: 0.01,
            paint_uneven: 0.5,
            gain: 0.003,
            ambient_grey: 0.1,
            floor: 0.004,
            floor_grey: 0.05,
            stray: (0.01, 60.0),
            lights_grey: 0.05,
            most: [160, 1200],
            few: [36, 300],
            steps: (3, 14),
            settled: 0.05,
            additions: 4,
            swaps: 2,
            effects: 7,
            worth: 4.6,
            unnamed: (0.02, 0.7),
            strays: 0.02,
        }
    }
}
