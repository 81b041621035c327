//! Target on the tank floor, and calibration board in the laser sheet.

mod board;
mod dictionary;
mod polygon;

pub(crate) use board::NoPlace;
pub use board::{Board, BoardPattern, GaugeBlock};
pub use dictionary::Dictionary;

use crate::raw::{Kind, Quantity, Section, angle, keys_of, name, number, numbers, tables, whole};
use polygon::corners;

/// A place in the target's frame.
const fn place() -> Quantity {
    number(-1000.0, 1000.0, "m")
}

const fn size() -> Quantity {
    number(0.0, 1000.0, "m").above()
}

shapes! {
    /// Its outline.
    ///
    /// Seen from above, in the target frame (X along the centre line, Y to starboard).
    pub enum SlabOutline by "shape" {
        /// Rectangle X in \[x0, x1\], |Y| <= width/2.
        Rectangle = "rectangle" {
            /// x of its start; of a rectangle and of a chain of hexagons.
            x0_m: f64 = place(),
            /// x of its end; of a rectangle.
            x1_m: f64 = place(),
            /// Width across the centre line; of a rectangle.
            width_m: f64 = size(),
        },
        /// Regular hexagons end to end along X: joints (width = side) at x0 + k*sqrt(3)*side, widest (2*side) half way.
        HexagonChain = "hexagon_chain" {
            /// x of the start of the first hexagon.
            x0_m: f64 = place(),
            /// Side of each hexagon; of a chain of hexagons.
            side_m: f64 = size(),
            /// Number of hexagons; of a chain of hexagons.
            count: u32 = whole(1, 1000, "hexagons"),
        },
        /// Any simple polygon.
        Polygon = "polygon" {
            /// 3 to 1000 corners in order round the outline; of a polygon.
            points_m: Vec<[f64; 2]> = corners(place()),
        },
    }
}

table! {
    /// A flat-topped part of the target: an outline in the target's frame (x along its centre line, y to starboard) and a
    /// height. At least one.
    pub struct Slab as SlabTyped, checked by start_before_end {
        /// Name of the slab.
        pub name: String = name(),
        /// Outline seen from above.
        pub outline: SlabOutline = keys_of(),
        /// Height of its top above the floor.
        pub top_m: f64 = number(0.0, 10.0, "m").above(),
        /// Brightness of its top, as a factor on that of the floor.
        pub albedo: f64 = number(0.0, 10.0, "").or(1.0),
    }
}

fn start_before_end(typed: &mut SlabTyped, s: &Section<'_>) {
    if let Some(SlabOutline::Rectangle { x0_m, x1_m, .. }) = typed.outline
        && x0_m >= x1_m
    {
        s.rule(
            "x1_m",
            format!("the slab ends at {x1_m} m, before its start at {x0_m} m"),
            "Enter x0_m below x1_m",
        );
    }
}

table! {
    /// Where a target lies on the floor.
    pub(crate) struct Placement: Copy as PlacementTyped {
        /// Where the target's start lies: X and Y in the tank frame. Omitted: that of the file, or [0, 0].
        pub origin_m: Option<[f64; 2]> = numbers(place()).optional(),
        /// Angle of its centre line against the tank's x axis. Omitted: that of the file, or 0.
        pub heading_rad: Option<f64> = angle(number(-360.0, 360.0, "deg")).optional(),
    }
}

table! {
    /// Target on the tank floor, written out or by `file`; `target = "FILE"` is the same as `file` alone. A target file has
    /// the same keys without the word target. Omitted: a bare floor.
    ///
    /// Where several slabs overlap the highest counts.
    pub struct Target as TargetTyped, checked by slabs_and_place {
        /// Name of the target.
        pub name: String = name(),
        key placement: Placement = keys_of() => |t| Some(t.placement()),
        /// Slabs of the target.
        key slab: Vec<Slab> = tables(256) => |t| Some(t.slabs.clone()),
        /// Slabs of the target.
        made slabs: Vec<Slab>,
        /// Position of the target's origin in the tank frame: X, Y \[m\] and its heading \[rad\].
        made origin: [f64; 3],
    }
}

fn slabs_and_place(typed: &mut TargetTyped, s: &Section<'_>) {
    if !s.has("slab") {
        s.missing(
            "slab",
            "at least one [[slab]]; for a bare floor leave the target out of the rig",
        );
    }
    let slabs = typed.slab.take().unwrap_or_default();
    for (i, slab) in slabs.iter().enumerate() {
        if slabs[..i].iter().any(|earlier| earlier.name == slab.name) {
            s.rule(
                &format!("slab[{i}].name"),
                format!("the name {} is used twice", slab.name),
                "Give every slab its own name",
            );
        }
    }
    typed.slabs = (!slabs.is_empty()).then_some(slabs);
    typed.origin = typed.placement.map(|placement| {
        let [x, y] = placement.origin_m.unwrap_or_default();
        [x, y, placement.heading_rad.unwrap_or_default()]
    });
}

impl Target {
    fn placement(&self) -> Placement {
        let [x, y, heading] = self.origin;
        Placement {
            origin_m: Some([x, y]),
            heading_rad: Some(heading),
        }
    }

    /// Lays it where a rig says; what the rig leaves out stays.
    pub(crate) fn place(&mut self, placement: Placement) {
        let [x, y, heading] = self.origin;
        let [x, y] = placement.origin_m.unwrap_or([x, y]);
        self.origin = [x, y, placement.heading_rad.unwrap_or(heading)];
    }
}
