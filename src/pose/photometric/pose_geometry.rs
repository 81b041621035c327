//! A ray against a level, with its derivatives by the pose; and all that depends on the pose alone.

use super::Photometric;
use crate::outline::Surfaces;
use hydroline_calib::Pose;
use nalgebra::Matrix3;

type Rows = [[f64; 3]; 3];

/// Rotation with its derivatives, and the edges of all upper faces as the body sees them.
pub(super) struct PoseGeometry {
    /// Body to tank.
    pub r: Rows,
    /// d r / d(φ, θ, ψ).
    pub by: [Rows; 3],
    pub position: [f64; 3],
    /// Edges of all upper faces, one upper face after the other.
    edges: Vec<EdgeGeometry>,
    /// First edge of each upper face.
    first: Vec<usize>,
}

/// An edge: its distance from the body point x is `offset_m` + `row`·x, positive inside.
#[derive(Clone, Copy)]
pub(super) struct EdgeGeometry {
    pub offset_m: f64,
    pub row: [f64; 3],
    /// d row / d(φ, θ, ψ).
    pub by: Rows,
    pub inward: [f64; 2],
}

impl EdgeGeometry {
    fn new(
        from_m: [f64; 2],
        inward: [f64; 2],
        r: &Rows,
        by: &[Rows; 3],
        position: &[f64; 3],
    ) -> Self {
        let [nx, ny] = inward;
        let turn = |m: &Rows| std::array::from_fn(|i| nx * m[0][i] + ny * m[1][i]);
        EdgeGeometry {
            offset_m: nx * (position[0] - from_m[0]) + ny * (position[1] - from_m[1]),
            row: turn(r),
            by: [turn(&by[0]), turn(&by[1]), turn(&by[2])],
            inward,
        }
    }
}

pub(super) fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl PoseGeometry {
    pub fn new(pose: &Pose, surfaces: &Surfaces) -> Self {
        let (sf, cf) = pose.phi_rad.sin_cos();
        let (st, ct) = pose.theta_rad.sin_cos();
        let (sp, cp) = pose.psi_rad.sin_cos();
        let rz = Matrix3::new(cp, -sp, 0.0, sp, cp, 0.0, 0.0, 0.0, 1.0);
        let ry = Matrix3::new(ct, 0.0, st, 0.0, 1.0, 0.0, -st, 0.0, ct);
        let rx = Matrix3::new(1.0, 0.0, 0.0, 0.0, cf, -sf, 0.0, sf, cf);
        let dz = Matrix3::new(-sp, -cp, 0.0, cp, -sp, 0.0, 0.0, 0.0, 0.0);
        let dy = Matrix3::new(-st, 0.0, ct, 0.0, 0.0, 0.0, -ct, 0.0, -st);
        let dx = Matrix3::new(0.0, 0.0, 0.0, 0.0, -sf, -cf, 0.0, cf, -sf);
        let rows = |m: Matrix3<f64>| -> Rows {
            std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]))
        };
        let mut geometry = PoseGeometry {
            r: rows(rz * ry * rx),
            by: [rows(rz * ry * dx), rows(rz * dy * rx), rows(dz * ry * rx)],
            position: pose.position_m().into(),
            edges: Vec::with_capacity(64),
            first: Vec::with_capacity(surfaces.faces.len()),
        };
        for face in &surfaces.faces {
            geometry.first.push(geometry.edges.len());
            for e in &face.outline.edges {
                let edge = geometry.edge_of(e.from_m, e.inward);
                geometry.edges.push(edge);
            }
        }
        geometry
    }

    pub fn edge(&self, face: usize, edge: usize) -> &EdgeGeometry {
        &self.edges[self.first[face] + edge]
    }

    /// An edge that is none of an upper face's own.
    pub fn edge_of(&self, from_m: [f64; 2], inward: [f64; 2]) -> EdgeGeometry {
        EdgeGeometry::new(from_m, inward, &self.r, &self.by, &self.position)
    }
}

/// A pixel's ray: the way to its sheet point, and d(y, z) of it along columns and rows \[m/px\].
pub(super) struct Ray {
    pub sight: [f64; 3],
    pub slopes: [[f64; 2]; 2],
}

/// A ray at one height.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    pub t: f64,
    pub t_slope: [f64; 2],
    /// dt/d(z, φ, θ).
    pub dt: [f64; 3],
    /// Body point.
    pub x: [f64; 3],
    /// Tank X, Y.
    pub p: [f64; 2],
}

impl Photometric {
    pub(super) fn hit(&self, geometry: &PoseGeometry, ray: &Ray, height_m: f64) -> Option<Hit> {
        let r3 = &geometry.r[2];
        let d = &ray.sight;
        let eye: [f64; 3] = [self.table.eye_m.x, self.table.eye_m.y, self.table.eye_m.z];
        let down = dot(r3, d);
        let inverse = 1.0 / down;
        let t = (-height_m - geometry.position[2] - dot(r3, &eye)) * inverse;
        if !(t.is_finite() && t > 0.0 && down > 0.0) {
            return None;
        }
        let x = [eye[0] + t * d[0], eye[1] + t * d[1], eye[2] + t * d[2]];
        let slope = |s: &[f64; 2]| -t * (r3[1] * s[0] + r3[2] * s[1]) * inverse;
        Some(Hit {
            t,
            t_slope: [slope(&ray.slopes[0]), slope(&ray.slopes[1])],
            dt: [
                -inverse,
                -dot(&geometry.by[0][2], &x) * inverse,
                -dot(&geometry.by[1][2], &x) * inverse,
            ],
            x,
            p: [
                geometry.position[0] + dot(&geometry.r[0], &x),
                geometry.position[1] + dot(&geometry.r[1], &x),
            ],
        })
    }
}
