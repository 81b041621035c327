use super::*;
use crate::fixture::lshpi_rig;
use hydroline_rigs::{GaugeBlock, ImageNoise};

fn board(pattern: BoardPattern) -> Board {
    Board {
        name: "test".into(),
        pattern,
        columns: 7,
        rows: 7,
        pitch_m: 0.05,
        margin_m: 0.05,
        thickness_m: 0.005,
        blocks: Vec::new(),
    }
}

fn renderer() -> Renderer {
    let mut rig = lshpi_rig();
    rig.camera.noise = ImageNoise {
        blur_px: 0.7,
        read_sd: 0.0,
        shot_gain: 0.0,
        ambient: 0.0,
    };
    rig.laser.peak = 100.0;
    Renderer::new(&rig).unwrap()
}

const ROOM: BoardLight = BoardLight {
    room: 200.0,
    slope_per_m: [0.0, 0.0],
    laser: false,
    grazing: 1.0,
};

#[test]
fn dots_lie_at_their_nodes() {
    let r = renderer();
    let b = board(BoardPattern::Dots { diameter_m: 0.012 });
    for place in [
        BoardPlacement::default(),
        BoardPlacement {
            centre_m: [0.02, -0.01],
            rotation_rad: 0.05,
            tilt_xi_rad: 0.1,
            tilt_eta_rad: -0.05,
            offset_m: 0.01,
        },
    ] {
        let image = r.render_board(&b, &place, &ROOM, 0).unwrap().0;
        let nodes = r.board_nodes(&b, &place).unwrap();
        assert_eq!(nodes.len(), 49);
        let mut worst = 0.0f64;
        for n in nodes
            .iter()
            .filter(|n| (15.0..700.0).contains(&n.column_px) && (15.0..560.0).contains(&n.row_px))
        {
            let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
            for row in n.row_px.round() as usize - 13..=n.row_px.round() as usize + 13 {
                for col in n.column_px.round() as usize - 13..=n.column_px.round() as usize + 13 {
                    let dark = 200.0 - f64::from(image[row * 720 + col]);
                    (sum, x, y) = (sum + dark, x + dark * col as f64, y + dark * row as f64);
                }
            }
            worst = worst.max((x / sum - n.column_px).hypot(y / sum - n.row_px));
        }
        // A disk's centroid is not its centre's image: perspective moves it by some 0.05 px at 12 mm and 45 deg.
        assert!(worst < 0.15, "a dot lies {worst} px from its node");
    }
}

#[test]
fn nodes_in_the_sheet_obey_eqs_11_and_12() {
    let r = renderer();
    let (eta_c, zeta_c, alpha) = (0.46f64, -0.46f64, std::f64::consts::FRAC_PI_4);
    let rig = lshpi_rig();
    for n in r
        .board_nodes(&board(BoardPattern::Chessboard), &BoardPlacement::default())
        .unwrap()
    {
        let (x_left, y_up, h) = (
            rig.camera.cx_px - n.column_px,
            rig.camera.cy_px - n.row_px,
            rig.camera.fx_px,
        );
        let (near, far) = (
            h * alpha.sin() + y_up * alpha.cos(),
            h * alpha.cos() - y_up * alpha.sin(),
        );
        let eta = eta_c + far / near * zeta_c;
        let xi = (zeta_c.powi(2) + (eta_c - eta).powi(2)).sqrt() / near.hypot(far) * x_left;
        assert!(
            (xi - n.plane_m[0]).abs() < 1e-12
                && (eta - n.plane_m[1]).abs() < 1e-12
                && n.plane_m[2] == 0.0
        );
    }
}

#[test]
fn the_sheet_lights_a_board_in_it_and_hardly_one_beside_it() {
    let r = renderer();
    let b = board(BoardPattern::Dots { diameter_m: 0.001 });
    let laser = BoardLight {
        room: 0.0,
        slope_per_m: [0.0, 0.0],
        laser: true,
        grazing: 1.0,
    };
    let faint = BoardLight {
        grazing: 0.1,
        ..laser
    };
    let image = r.render_board(&b, &BoardPlacement::default(), &faint, 0);
    assert!((f64::from(image.unwrap().0[310 * 720 + 370]) - 10.0).abs() <= 1.0);
    let level = |offset_m: f64| {
        let image = r
            .render_board(
                &b,
                &BoardPlacement {
                    offset_m,
                    ..BoardPlacement::default()
                },
                &laser,
                0,
            )
            .unwrap()
            .0;
        f64::from(image[310 * 720 + 370])
    };
    // exp(-1/2 (d / 2 mm)^2)
    assert!((level(0.0) - 100.0).abs() <= 1.0);
    assert!((level(0.002) - 60.65).abs() <= 1.0);
    assert!(level(0.01) < 1.0);
}

#[test]
fn a_gauge_block_shows_the_sheet_on_its_upper_side_and_shadows_below() {
    let r = renderer();
    let mut b = board(BoardPattern::Dots { diameter_m: 0.001 });
    b.blocks.push(GaugeBlock {
        centre_m: [0.025, 0.025],
        size_m: [0.03, 0.01],
        height_m: 0.02,
    });
    let laser = BoardLight {
        room: 0.0,
        slope_per_m: [0.0, 0.0],
        laser: true,
        grazing: 1.0,
    };
    // Face 10 mm behind the sheet: the sheet crosses the block's upper side half way up.
    let place = BoardPlacement {
        offset_m: 0.01,
        ..BoardPlacement::default()
    };
    let image = r.render_board(&b, &place, &laser, 0).unwrap().0;
    let lit: Vec<usize> = (0..image.len()).filter(|&i| image[i] > 30).collect();
    assert!(lit.len() > 50, "{} pixels", lit.len());
    // All of them where the sheet's line at eta = 0.03 (block's top) is seen: xi 0.01 .. 0.04.
    let corner = |xi: f64, eta: f64| {
        let placed = BoardPlacement {
            centre_m: [xi, eta],
            ..BoardPlacement::default()
        };
        let one = Board {
            columns: 1,
            rows: 1,
            ..b.clone()
        };
        let n = r.board_nodes(&one, &placed).unwrap()[0];
        (n.column_px, n.row_px)
    };
    let ((right, row), (left, _)) = (corner(0.01, 0.03), corner(0.04, 0.03));
    for i in lit {
        let (c, v) = ((i % 720) as f64, (i / 720) as f64);
        assert!(
            c > left - 3.0 && c < right + 3.0 && (v - row).abs() < 6.0,
            "{c} {v}: {left} {right} {row}"
        );
    }
    // Board in the sheet: below the block the face is in its shadow, beside it is lit.
    let image = r
        .render_board(&b, &BoardPlacement::default(), &laser, 0)
        .unwrap()
        .0;
    let at = |xi, eta| {
        let (c, v) = corner(xi, eta);
        image[v.round() as usize * 720 + c.round() as usize]
    };
    assert!(
        at(0.025, -0.03) < 3 && at(-0.05, -0.03) > 90,
        "{} {}",
        at(0.025, -0.03),
        at(-0.05, -0.03)
    );
}

#[test]
fn uneven_light_noise_and_bad_boards() {
    let r = Renderer::new(&lshpi_rig()).unwrap();
    let b = board(BoardPattern::Chessboard);
    let uneven = BoardLight {
        room: 120.0,
        slope_per_m: [2.0, 0.0],
        laser: true,
        grazing: 1.0,
    };
    let place = BoardPlacement {
        tilt_eta_rad: 0.02,
        ..BoardPlacement::default()
    };
    let image = r.render_board(&b, &place, &uneven, 3).unwrap();
    assert_eq!(image, r.render_board(&b, &place, &uneven, 3).unwrap());
    assert_ne!(image, r.render_board(&b, &place, &uneven, 4).unwrap());
    let bad = Board {
        pitch_m: f64::NAN,
        ..b
    };
    assert!(matches!(
        r.render_board(&bad, &place, &uneven, 0),
        Err(SceneError::Board {
            what: "pitch_m",
            ..
        })
    ));
    let lines = board(BoardPattern::Lines { line_m: 0.002 });
    assert!(r.render_board(&lines, &place, &ROOM, 0).is_ok());
}

impl Renderer {
    /// One frame of a board; everything else in view is dark (ambient and noise only).
    pub(in crate::scene) fn render_board(
        &self,
        board: &Board,
        placement: &BoardPlacement,
        light: &BoardLight,
        frame_index: u64,
    ) -> Result<GreyPixels, SceneError> {
        let picture = self.board_picture(board, placement, light)?;
        Ok(self.develop_board(&picture, frame_index))
    }

    /// Where every node of the board lies, in the image (whether inside or not; NaN behind the camera's port)
    /// and in the laser plane.
    ///
    /// # Errors
    /// [`SceneError::Board`] for a board without extent.
    fn board_nodes(
        &self,
        board: &Board,
        placement: &BoardPlacement,
    ) -> Result<Vec<BoardNode>, SceneError> {
        check(board)?;
        let (to_plane, centre) = frame(placement);
        let (eye, axes) = self.camera_axes();
        let pixel = axes.try_inverse().unwrap_or_else(Matrix3::zeros);
        let lens = (!Lens::is_pinhole(&self.optics)).then(|| Lens::new(&self.optics));
        let mut nodes = Vec::with_capacity((board.columns * board.rows) as usize);
        for row in 0..board.rows {
            for column in 0..board.columns {
                let local = Vector3::new(
                    (f64::from(column) - f64::from(board.columns - 1) / 2.0) * board.pitch_m,
                    (f64::from(row) - f64::from(board.rows - 1) / 2.0) * board.pitch_m,
                    0.0,
                );
                let plane = centre + to_plane * local;
                let body = self.body_of_plane(plane);
                // Direction = b u + c v + a w; its pixel is (u, v) / w.
                let d = pixel * (body - eye);
                let [column_px, row_px] = match &lens {
                    None => [d.x / d.z, d.y / d.z],
                    Some(lens) => lens.project(&body).unwrap_or([f64::NAN; 2]),
                };
                nodes.push(BoardNode {
                    column,
                    row,
                    column_px,
                    row_px,
                    plane_m: plane.into(),
                });
            }
        }
        Ok(nodes)
    }
}

/// Where a node of the board really is.
#[derive(Debug, Clone, Copy, PartialEq)]
struct BoardNode {
    /// Index along +xi, 0 = lowest xi (starboard).
    pub column: u32,
    /// Index along +eta, 0 = lowest.
    pub row: u32,
    /// Image column \[px\].
    pub column_px: f64,
    /// Image row \[px\].
    pub row_px: f64,
    /// xi, eta, zeta of the node itself \[m\]; zeta is 0 only for a board in the sheet.
    pub plane_m: [f64; 3],
}
