//! The light of the picture: which effects light it, and what the frames are without them.
//!
//! `samples` (grey levels across the stripe and of the background) -> `camera` (mean grey level of some light)
//! -> `forward` (light of laser and background under some optics) -> `fit` (mode and evidence of one model) ->
//! `search` (models, marginals) -> `removed` (the frames without what was found) -> `entries` (into the verdict).
//!
//! Every effect whose law changes what `forward` predicts of these frames' samples is a candidate; nothing here
//! knows one by name. Rows are taken as measured and poses are not needed: what moves the stripe is the profiles'
//! (`search` one room up), which are read anew from the frames without what lights them. Numbers have the priors of
//! the motion level's table, and a light of no known effect (a smooth field of gain and background, of any size) is part
//! of every model, as the random force is there.

mod camera;
mod candidate;
mod entries;
mod equations;
mod fit;
mod forward;
mod options;
mod removed;
mod samples;
mod search;

pub use candidate::LightCandidate;
pub use entries::LightEffect;
pub use fit::LightFit;
pub use options::LightOptions;
pub use search::{Looked, look};

#[cfg(test)]
mod eyes;
#[cfg(test)]
mod tests;
