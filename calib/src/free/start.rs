//! Where the bundle adjustment starts: focal length and poses from homographies, the sheet from points of the line.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::bundle::{Pose, State};
use super::sheet::LaserSurface;
use super::{Seen, camera};
use crate::map::geometry::homography;

/// Focal length of a camera whose pixels are square and whose axis meets the image's middle \[px\] (Zhang 2000, two
/// equations per board: its axes are perpendicular and of one length); `None` where the boards do not say.
pub(super) fn focal_px(homographies: &[Matrix3<f64>], centre: Vector2<f64>) -> Option<f64> {
    // ω = diag(w, w, 1) about the centre, w = 1/f²: p w + q = 0 for each equation.
    let (mut pp, mut pq) = (0.0, 0.0);
    let shift = Matrix3::new(1.0, 0.0, -centre[0], 0.0, 1.0, -centre[1], 0.0, 0.0, 1.0);
    for h in homographies {
        let m = shift * h;
        let (a, b) = (m.column(0), m.column(1));
        let size = a.norm() * b.norm();
        let equations = [
            (a[0] * b[0] + a[1] * b[1], a[2] * b[2]),
            (
                a[0] * a[0] + a[1] * a[1] - b[0] * b[0] - b[1] * b[1],
                a[2] * a[2] - b[2] * b[2],
            ),
        ];
        for (p, q) in equations {
            pp += (p / size).powi(2);
            pq += p * q / (size * size);
        }
    }
    let w = -pq / pp;
    (w > 0.0 && w.is_finite()).then(|| w.sqrt().recip())
}

/// Homography from the board \[m\] to the image of each view.
pub(super) fn homographies(views: &[&Seen]) -> Vec<Option<Matrix3<f64>>> {
    let of = |view: &&Seen| {
        let pairs: Vec<_> = (view.nodes.iter()).map(|n| (n.board_m, n.pixel)).collect();
        homography(&pairs)
    };
    views.iter().map(of).collect()
}

/// Pose of a board seen with that homography by a pinhole.
pub(super) fn pose(
    h: &Matrix3<f64>,
    focal_px: f64,
    aspect: f64,
    centre: Vector2<f64>,
) -> Option<Pose> {
    let k = Matrix3::new(
        focal_px,
        0.0,
        centre[0],
        0.0,
        aspect * focal_px,
        centre[1],
        0.0,
        0.0,
        1.0,
    );
    let m = k.try_inverse()? * h;
    let mut scale = 2.0 / (m.column(0).norm() + m.column(1).norm());
    if m[(2, 2)] < 0.0 {
        scale = -scale;
    }
    let (a, b, t) = (
        m.column(0) * scale,
        m.column(1) * scale,
        m.column(2) * scale,
    );
    let svd = Matrix3::from_columns(&[a, b, a.cross(&b)]).svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    let sound = rotation.iter().chain(t.iter()).all(|v| v.is_finite()) && t[2] > 0.0;
    sound.then_some(Pose {
        rotation,
        translation: t,
    })
}

/// Points of the line in space, by view: where the rays meet the boards \[m\].
pub(super) fn line_points(state: &State, views: &[&Seen]) -> Vec<Vec<Vector3<f64>>> {
    let of = |(view, pose): (&&Seen, &Pose)| {
        let point = |p: &crate::detect::LinePoint| {
            let (from, along) = state.lens.ray(&Vector2::from(p.pixel))?;
            pose.meet(&from, &along)
        };
        view.line.iter().filter_map(point).collect()
    };
    views.iter().zip(&state.poses).map(of).collect()
}

/// The plane nearest to most lines: through two of them, whichever leaves the least median distance.
pub(super) fn plane(lines: &[Vec<Vector3<f64>>]) -> Option<LaserSurface> {
    let lines: Vec<&Vec<Vector3<f64>>> = lines.iter().filter(|l| l.len() >= 4).collect();
    let mut best: Option<(f64, Vector3<f64>)> = None;
    for (k, a) in lines.iter().enumerate() {
        for b in &lines[k + 1..] {
            let both: Vec<Vector3<f64>> = a.iter().chain(b.iter()).copied().collect();
            let Some(m) = least_squares(&both) else {
                continue;
            };
            let distance = |p: &Vector3<f64>| ((m.dot(p) - 1.0) / m.norm()).abs();
            let mut off: Vec<f64> = (lines.iter())
                .map(|line| line.iter().map(distance).sum::<f64>() / line.len() as f64)
                .collect();
            off.sort_by(f64::total_cmp);
            let median = off[off.len() / 2];
            if best.is_none_or(|(least, _)| median < least) {
                best = Some((median, m));
            }
        }
    }
    let (_, m) = best?;
    let all: Vec<Vector3<f64>> = lines.iter().flat_map(|l| l.iter().copied()).collect();
    let origin = all.iter().sum::<Vector3<f64>>() / all.len() as f64;
    let along: Vector3<f64> = (lines.iter())
        .filter_map(|l| Some(l.last()? - l.first()?))
        .fold(Vector3::zeros(), |sum, d| {
            if sum.dot(&d) < 0.0 { sum - d } else { sum + d }
        });
    LaserSurface::plane(
        m,
        origin - m * ((m.dot(&origin) - 1.0) / m.norm_squared()),
        along,
    )
}

/// The plane m·X = 1 with the least squared distances from points; `None` where they lie on a line.
fn least_squares(points: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let n = points.len() as f64;
    let mean = points.iter().sum::<Vector3<f64>>() / n;
    let scatter = points.iter().fold(Matrix3::zeros(), |s, p| {
        let d = p - mean;
        s + d * d.transpose()
    });
    let eigen = scatter.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    // A plane needs an extent in two directions: a hundredth of the larger one is noise of a line.
    if eigen.eigenvalues[order[1]] < 1e-4 * eigen.eigenvalues[order[2]] {
        return None;
    }
    let normal: Vector3<f64> = eigen.eigenvectors.column(order[0]).into();
    let offset = normal.dot(&mean);
    (offset.abs() > 1e-6).then(|| normal / offset)
}

/// State to start from: the camera of the prior, its focal length by the boards where the prior leaves it open.
pub(super) fn state(views: &[&Seen], lens: camera::Lens, focal_known: bool) -> Option<State> {
    let homographies = homographies(views);
    let known: Vec<Matrix3<f64>> = homographies.iter().flatten().copied().collect();
    let centre = Vector2::new(
        lens.numbers[camera::CENTRE],
        lens.numbers[camera::CENTRE + 1],
    );
    let mut lens = lens;
    // In water a camera looks as if its focal length were n times longer.
    let n = if lens.plate.is_some() {
        lens.numbers[camera::MEDIUM]
    } else {
        1.0
    };
    if !focal_known {
        let range = 0.15 * lens.numbers[camera::FOCAL]..12.0 * lens.numbers[camera::FOCAL];
        let seen = focal_px(&known, centre)
            .map(|f| f / n)
            .filter(|f| range.contains(f));
        lens.numbers[camera::FOCAL] = seen.unwrap_or(lens.numbers[camera::FOCAL]);
    }
    let apparent = n * lens.numbers[camera::FOCAL];
    let poses = (homographies.iter())
        .map(|h| pose(h.as_ref()?, apparent, lens.numbers[camera::ASPECT], centre))
        .collect::<Option<Vec<Pose>>>()?;
    Some(State {
        lens,
        sheet: None,
        poses,
    })
}
