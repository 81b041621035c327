//! Figures of a fit: what is left of the profiles, in the frames fitted and in those held out.

use super::super::candidate::{Base, Candidate};
use super::super::fit::{Fitted, Free, State};
use super::super::model::Kind;
use super::super::observe::ImageRun;
use super::super::picture;
use super::super::search::Searched;
use super::{ImageError, problem};
use crate::verdict::BeforeAfter;
use hydroline_rigs::Rig;
use std::collections::BTreeMap;

fn by_kind(of: impl Fn(Kind) -> f64) -> BTreeMap<String, f64> {
    [
        ("row_px", Kind::Row),
        ("width_px", Kind::Width),
        ("edge_column_px", Kind::End),
    ]
    .into_iter()
    .map(|(name, kind)| (name.to_owned(), of(kind)))
    .collect()
}

/// Residual rms of each kind, strays aside \[px\].
pub(super) fn rms(fit: &Fitted) -> BTreeMap<String, f64> {
    by_kind(|kind| fit.rms_px(kind))
}

/// Rms to expect of each kind by the measurements' sds, floors included \[px\].
pub(super) fn noise(fit: &Fitted) -> BTreeMap<String, f64> {
    by_kind(|kind| {
        let own = fit.left.iter().filter(|l| l.kind == kind);
        let (sum, n) = own.fold((0.0, 0usize), |(s, n), l| (s + l.sd_px.powi(2), n + 1));
        (sum / n.max(1) as f64).sqrt()
    })
}

/// Every other frame predicted by what the rest gives: shared numbers and effects are held, only
/// each frame's own pose is fitted.
pub(super) fn held_out(
    runs: &[ImageRun],
    rig: &Rig,
    candidates: &[Candidate],
    found: &Searched,
) -> Result<BeforeAfter, ImageError> {
    let part = |odd: usize| -> Vec<ImageRun> {
        runs.iter()
            .map(|r| ImageRun {
                frames: r.frames.iter().skip(odd).step_by(2).cloned().collect(),
                ..r.clone()
            })
            .collect()
    };
    let (even, odd) = (part(0), part(1));
    let (train, test) = (
        problem(&even, rig, Base::new(rig)?)?,
        problem(&odd, rig, Base::new(rig)?)?,
    );
    let half = |state: &State, from: usize| State {
        poses: state
            .poses
            .iter()
            .map(|p| p.iter().skip(from).step_by(2).copied().collect())
            .collect(),
        ..state.clone()
    };
    let predicted = |fit: &Fitted| {
        let learnt = train.fit(candidates, &fit.effects, half(&fit.state, 0), Free::All)?;
        let begin = State {
            poses: half(&fit.state, 1).poses,
            ..learnt.state
        };
        test.fit(candidates, &fit.effects, begin, Free::Poses)
    };
    let best = found.best();
    let after = predicted(best);
    Ok(BeforeAfter {
        before: if best.effects.is_empty() {
            after.as_ref().map(rms)
        } else {
            predicted(&found.nothing).as_ref().map(rms)
        }
        .unwrap_or_default(),
        noise: after.as_ref().map(noise).unwrap_or_default(),
        after: after.as_ref().map(rms).unwrap_or_default(),
    })
}

/// Mean residual of the rows in the part of the image where it is largest, and that in its own
/// sds: without effects, and with them; and where the first is.
pub(super) fn worst(nothing: &Fitted, best: &Fitted, rig: &Rig) -> ([(f64, f64); 2], String) {
    let of = |fit: &Fitted| {
        picture::cells(fit, rig)
            .into_iter()
            .filter(|c| c.count >= 8)
            .map(|c| (c.mean_px.abs(), c.mean_px.abs() / c.sd_px, c))
            .max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let (before, after) = (of(nothing), of(best));
    let part = before.as_ref().map_or_else(String::new, |(.., c)| {
        format!(
            "columns {:.0} to {:.0}, rows {:.0} to {:.0}",
            c.from_px[0], c.to_px[0], c.from_px[1], c.to_px[1]
        )
    });
    let pair = |o: Option<(f64, f64, picture::Cell)>| o.map_or((0.0, 0.0), |(a, b, _)| (a, b));
    ([pair(before), pair(after)], part)
}
