//! The rig, target, board and plan files compiled in, so that `demo` and
//! `--rig lshpi` work without a file on disk.

/// (name, text) of every built-in of a kind: `rig`, `plan`, `target` or `board`.
pub(crate) fn files(kind: &str) -> &'static [(&'static str, &'static str)] {
    match kind {
        "rig" => &[
            ("lshpi", include_str!("../lshpi.toml")),
            ("bench-v4l", include_str!("../bench-v4l.toml")),
            ("bluerov2", include_str!("../bluerov2.toml")),
            ("bluerov2-heavy", include_str!("../bluerov2-heavy.toml")),
        ],
        "plan" => &[
            ("surge-4n", include_str!("../plans/surge-4n.toml")),
            ("surge-8n", include_str!("../plans/surge-8n.toml")),
            ("still", include_str!("../plans/still.toml")),
            ("reversals", include_str!("../plans/reversals.toml")),
            ("coast-down", include_str!("../plans/coast-down.toml")),
            ("two-tone", include_str!("../plans/two-tone.toml")),
            ("mixed-6dof", include_str!("../plans/mixed-6dof.toml")),
            (
                "bluerov2-mixed",
                include_str!("../plans/bluerov2-mixed.toml"),
            ),
            (
                "bluerov2-heavy-mixed",
                include_str!("../plans/bluerov2-heavy-mixed.toml"),
            ),
        ],
        "target" => &[
            ("hexagons", include_str!("../targets/hexagons.toml")),
            ("sway-board", include_str!("../targets/sway-board.toml")),
            ("two-level", include_str!("../target-two-level.toml")),
        ],
        "board" => &[
            ("wc-lines-50", include_str!("../boards/wc-lines-50.toml")),
            ("dots-50", include_str!("../boards/dots-50.toml")),
            ("chess-25", include_str!("../boards/chess-25.toml")),
            ("charuco-25", include_str!("../boards/charuco-25.toml")),
        ],
        _ => &[],
    }
}

/// Output of `hydroline rig new`.
pub(crate) const TEMPLATE: &str = include_str!("../template.toml");
