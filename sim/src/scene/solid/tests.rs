use super::*;
use crate::fixture::hexagon_target;
use proptest::prelude::*;

/// Walks down the line in small steps: the definition, without any of the geometry above.
fn marched(solid: &Solid, line: &Line) -> (f64, Surface) {
    let n = 20_000;
    let floor_t = -line.origin[2] / line.direction[2];
    for i in 0..=n {
        let t = floor_t * f64::from(i) / f64::from(n);
        let h = line.origin[2] + t * line.direction[2];
        if let Some(p) = solid
            .prisms
            .iter()
            .find(|p| p.contains(line.xy(t)) && h <= p.top_m)
        {
            return (t, Surface::Slab(p.index));
        }
    }
    (floor_t, Surface::Floor)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn first_hit_is_what_marching_finds(
        x in -0.3..1.3f64, y in -0.4..0.4f64, h in 0.05..1.0f64, dx in -3.0..3.0f64, dy in -3.0..3.0f64,
    ) {
        let solid = Solid::new(Some(&hexagon_target()), 1.0).unwrap();
        let line = Line { origin: [x, y, h], direction: [dx, dy, -1.0] };
        let hit = solid.first_hit(&line).unwrap();
        let (t, surface) = marched(&solid, &line);
        // A step of the march is h/20000; grazing corners may differ by one step's clip.
        if hit.surface == surface {
            prop_assert!((hit.t - t).abs() <= h / 10_000.0);
        } else {
            let clip = Line { origin: line.xy(hit.t).iter().copied().chain([h - hit.t]).collect::<Vec<_>>().try_into().unwrap(), direction: line.direction };
            let gone = solid.first_hit(&Line { origin: [clip.origin[0] + 2e-4 * dx, clip.origin[1] + 2e-4 * dy, clip.origin[2]], direction: line.direction });
            prop_assert!(gone.is_some_and(|g| g.surface == surface), "{hit:?} against {surface:?} at {t}");
        }
    }

    #[test]
    fn sees_agrees_with_first_hit(
        x in -0.3..1.3f64, y in -0.4..0.4f64, h in 0.01..1.0f64, dx in -3.0..3.0f64, dy in -3.0..3.0f64,
    ) {
        let solid = Solid::new(Some(&hexagon_target()), 1.0).unwrap();
        let line = Line { origin: [x, y, h], direction: [dx, dy, -1.0] };
        let hit = solid.first_hit(&line).unwrap();
        for (level, (height_m, surface)) in solid.levels().enumerate() {
            let expected = hit.surface == surface && !hit.face && height_m < h;
            prop_assert_eq!(height_m < h && solid.sees(&line, level, h - height_m), expected, "{:?}", surface);
        }
    }

    #[test]
    fn what_is_buried_is_never_seen(
        x in 0.0..1.2f64, y in -0.15..0.15f64, w in 0.001..0.03f64, fx in 0.0..1.0f64, fy in 0.0..1.0f64,
        dx in -3.0..3.0f64, dy in -3.0..3.0f64,
    ) {
        let solid = Solid::new(Some(&hexagon_target()), 1.0).unwrap();
        for (level, (height_m, _)) in solid.levels().enumerate() {
            if solid.buried(level, [x, x + w, y, y + 0.002]) {
                let end = [x + fx * w, y + fy * 0.002];
                let line = Line { origin: [end[0] - 0.8 * dx, end[1] - 0.8 * dy, height_m + 0.8], direction: [dx, dy, -1.0] };
                prop_assert!(!solid.sees(&line, level, 0.8));
            }
        }
    }

    #[test]
    fn crossings_of_the_chain_are_those_of_its_polygon(
        x in -0.2..1.4f64, y in -0.3..0.3f64, dx in -0.5..0.5f64, dy in -0.5..0.5f64,
    ) {
        let chain = Solid::new(Some(&hexagon_target()), 1.0).unwrap().prisms[0].clone();
        let polygon = Prism { inside: Inside::Polygon(Vec::new()), ..chain.clone() };
        let (p, q) = ([x, y], [x + dx, y + dy]);
        prop_assert_eq!(chain.first_crossing(p, q), polygon.first_crossing(p, q));
    }

    #[test]
    fn the_hexagon_chain_is_its_own_polygon(x in -0.1..1.4f64, y in -0.2..0.2f64) {
        let chain = Solid::new(Some(&hexagon_target()), 1.0).unwrap().prisms[0].clone();
        let corners: Vec<[f64; 2]> = chain.edges.iter().map(|e| e[0]).collect();
        let polygon = Prism { inside: Inside::Polygon(corners), ..chain.clone() };
        prop_assert_eq!(chain.contains([x, y]), polygon.contains([x, y]));
    }
}

#[test]
fn bad_outlines_are_named() {
    let mut target = hexagon_target();
    target.slabs[0].outline = SlabOutline::Polygon {
        points_m: vec![[0.0, 0.0], [1.0, 0.0]],
    };
    let error = Solid::new(Some(&target), 1.0).unwrap_err();
    assert!(error.to_string().contains("board"), "{error}");
    target = hexagon_target();
    target.slabs[1].top_m = f64::NAN;
    assert!(matches!(
        Solid::new(Some(&target), 1.0),
        Err(SceneError::Outline { .. })
    ));
}
