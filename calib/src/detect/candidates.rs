//! Where a node may be: extrema of the Hessian's determinant.
//!
//! Two dark lines that cross, and a dark dot, are dark in every direction: det H > 0 with
//! positive curvature, while along a single line one curvature vanishes. A chessboard's
//! corner is a saddle: det H < 0. One filter serves all three patterns.

use hydroline_rigs::BoardPattern;

use super::image::Plane;

/// A possible node, image pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub position: [f64; 2],
    /// Hessian (xx, xy, yy) of the smoothed, reduced image.
    pub hessian: [f32; 3],
    /// ±det H.
    pub strength: f32,
}

/// The strongest local maxima, at most `limit`, strongest first.
pub(super) fn find(plane: &Plane, pattern: BoardPattern, limit: usize) -> Vec<Candidate> {
    const BORDER: usize = 5;
    let (w, h) = (plane.width, plane.height);
    if w <= 2 * BORDER + 2 || h <= 2 * BORDER + 2 {
        return Vec::new();
    }
    let saddle = pattern.is_chess();
    let sign = if saddle { -1.0f32 } else { 1.0 };
    let mut response = vec![0.0f32; w * h];
    for r in BORDER..h - BORDER {
        // Windows, not indices: this is every pixel of three planes, and without bounds to check
        // the compiler takes four at a time.
        let triples =
            |r: usize| plane.values[r * w + BORDER - 1..(r + 1) * w - BORDER + 1].windows(3);
        let out = &mut response[r * w + BORDER..(r + 1) * w - BORDER];
        let lines = triples(r - 1).zip(triples(r)).zip(triples(r + 1));
        for (out, ((up, mid), low)) in out.iter_mut().zip(lines) {
            let xx = mid[0] - 2.0 * mid[1] + mid[2];
            let yy = up[1] - 2.0 * mid[1] + low[1];
            let xy = 0.25 * (up[0] + low[2] - up[2] - low[0]);
            let det = sign * (xx * yy - xy * xy);
            let trace = xx + yy;
            // A blob is dark on all sides alike: along a line noise makes det > 0 as well,
            // but with one curvature near zero (0.08 = 1 : 10). The two curvatures of a
            // saddle differ by 1 : 7 when the squares are seen as 45° diamonds.
            let square = trace * trace;
            let shaped = if saddle {
                square < 5.0 * det
            } else {
                (trace > 0.0) & (det > 0.08 * square)
            };
            *out = if shaped { det } else { 0.0 };
        }
    }
    // Noise of 2 grey levels leaves about 1 (full size) to 0.1 (halved) here; second derivatives of smoothed noise fall with
    // the smoothing's third power.
    let floor = (4.0 / (plane.reduction * plane.reduction) as f32 + 2.0)
        / (plane.smoothing * plane.smoothing * plane.smoothing) as f32;
    let mut found = Vec::new();
    for r in BORDER..h - BORDER {
        for c in BORDER..w - BORDER {
            let v = response[r * w + c];
            if v < floor {
                continue;
            }
            let largest = (r - 2..=r + 2).all(|y| {
                response[y * w + c - 2..=y * w + c + 2]
                    .iter()
                    .all(|&o| o <= v)
            });
            if !largest {
                continue;
            }
            let at = |dc: i64, dr: i64| {
                response[(r as i64 + dr) as usize * w + (c as i64 + dc) as usize]
            };
            let vertex = |a: f32, b: f32, c: f32| {
                let curvature = a - 2.0 * b + c;
                if curvature < 0.0 {
                    (0.5 * (a - c) / curvature).clamp(-0.5, 0.5)
                } else {
                    0.0
                }
            };
            let dc = vertex(at(-1, 0), v, at(1, 0));
            let dr = vertex(at(0, -1), v, at(0, 1));
            let k = plane.reduction as f64;
            let image = |x: f64| (x + 0.5) * k - 0.5;
            let m = &plane.values;
            let i = r * w + c;
            found.push(Candidate {
                position: [
                    image(c as f64 + f64::from(dc)),
                    image(r as f64 + f64::from(dr)),
                ],
                hessian: [
                    m[i - 1] - 2.0 * m[i] + m[i + 1],
                    0.25 * (m[i - w - 1] + m[i + w + 1] - m[i - w + 1] - m[i + w - 1]),
                    m[i - w] - 2.0 * m[i] + m[i + w],
                ],
                strength: v,
            });
        }
    }
    found.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    found.truncate(limit);
    found
}
