//! Marks of the plots of error against cost, and their legend.

use super::{
    fonts::text_width,
    picture::Anchor,
    picture::{Colour, Pen, Picture, Type},
    place::Box4,
    plot::{BLUE, INK, MUTED, VERMILION, label},
};
use needle_studies::accuracy::{Case, Steps};

const GREEN: Colour = Colour(0x1b, 0x8a, 0x5a, 1.0);
/// Left, top, right, bottom of the marks' area, px.
pub(super) const AREA: Box4 = [84.0, 190.0, 1136.0, 796.0];
/// Half of a mark's width, px.
pub(super) const MARK: f64 = 4.6;

/// Colour of a method.
fn colour(case: &Case) -> Colour {
    match case.method.as_str() {
        "mmls" => BLUE,
        "mls" => VERMILION,
        _ => GREEN,
    }
}

/// The legend of colours, marks and lines, above [`AREA`].
pub(super) fn legend(picture: &mut Picture) {
    let text = |picture: &mut Picture, x: &mut f64, y: f64, words: &str| {
        picture.text([*x, y], words, Type { colour: INK, ..label(Anchor::Start) });
        *x += text_width(words, 13.0, false) + 22.0;
    };
    let mut x = AREA[0];
    for (word, name) in [
        ("mmls", "modified moving least squares"),
        ("mls", "linear moving least squares"),
        ("tet4", "linear finite elements"),
    ] {
        let case = sample(word, "projected", "axisymmetric", 1000.0);
        picture.rectangle([x, 95.0], [x + 12.0, 107.0], colour(&case));
        x += 18.0;
        text(picture, &mut x, 106.0, name);
    }
    let rows: [&[(Case, &str)]; 2] = [
        &[
            (sample("", "projected", "axisymmetric", 1000.0), "half plane"),
            (sample("", "projected", "full", 1000.0), "three dimensions"),
            (sample("", "projected", "mirrored", 1000.0), "half of it"),
            (Case { points_per_hexahedron: 8, ..sample("", "projected", "full", 1000.0) }, "hexahedra"),
            (sample("", "pointwise", "full", 1000.0), "locking not cured"),
            (sample("", "averaged", "full", 1000.0), "locking half cured (averaged)"),
        ],
        &[
            (sample("", "projected", "axisymmetric", 1000.0), "filled: 1000 poses per second"),
            (sample("", "projected", "axisymmetric", 100.0), "hollow: 100"),
            (
                Case { corrected: true, ..sample("", "projected", "mirrored", 1000.0) },
                "ring: corrected by a finer cloud",
            ),
        ],
    ];
    for (k, row) in rows.into_iter().enumerate() {
        let (mut x, y) = (AREA[0] + 6.0, 128.0 + 22.0 * k as f64);
        for (case, words) in row {
            shape(picture, [x, y - 4.5], case, MUTED);
            x += 13.0;
            text(picture, &mut x, y, words);
        }
        if k == 1 {
            for (words, pen) in
                [("best at 1000 Hz", Pen::new(INK, 1.4)), ("best at 100 Hz", Pen::new(INK, 1.4).dashed([6.0, 4.0]))]
            {
                picture.line([[x, y - 4.5], [x + 26.0, y - 4.5]], pen);
                x += 33.0;
                text(picture, &mut x, y, words);
            }
        }
    }
}

/// A case for the legend.
fn sample(method: &str, volume_ratio: &str, dimension: &str, pose_hz: f64) -> Case {
    Case {
        method: method.to_owned(),
        volume_ratio: volume_ratio.to_owned(),
        dimension: dimension.to_owned(),
        spacing_m: 0.0,
        edge_spacing_m: 0.0,
        growth: 0.3,
        path_rings: 0,
        support_factor: 1.8,
        points_per_cell: 1,
        cells_per_point: 1,
        points_per_support_node: 1,
        points_per_hexahedron: 0,
        precision: "f32".to_owned(),
        pose_hz,
        steps: Steps::Auto,
        corrected: false,
    }
}

/// The mark of a run.
pub(super) fn mark(picture: &mut Picture, at: [f64; 2], case: &Case) {
    shape(picture, at, case, colour(case));
}

/// Disc: half plane; square: three dimensions; triangle: half of it; hexagon: hexahedra; hollow: a slow stream of
/// poses. Crosses: locking not treated. With a ring: corrected.
fn shape(picture: &mut Picture, [x, y]: [f64; 2], case: &Case, colour: Colour) {
    let Colour(r, g, b, _) = colour;
    let pen = Pen::new(colour, 1.5);
    let m = MARK;
    match case.volume_ratio.as_str() {
        "pointwise" => {
            picture.line([[x - m, y - m], [x + m, y + m]], Pen::new(colour, 2.0));
            picture.line([[x - m, y + m], [x + m, y - m]], Pen::new(colour, 2.0));
            return;
        }
        "averaged" => {
            picture.line([[x - m, y], [x + m, y]], Pen::new(colour, 2.0));
            picture.line([[x, y - m], [x, y + m]], Pen::new(colour, 2.0));
            return;
        }
        _ => {}
    }
    let polygon = |corners: u32, m: f64| -> Vec<[f64; 2]> {
        let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(corners);
        (0..=corners).map(|i| angle(i).sin_cos()).map(|(s, c)| [x + m * c, y + m * s]).collect()
    };
    let outline = if case.is_half_plane() {
        polygon(20, m)
    } else if case.has_hexahedra() {
        polygon(6, 1.3 * m)
    } else if case.is_half() {
        // an upright triangle
        [[-1.2, 0.8], [1.2, 0.8], [0.0, -1.3], [-1.2, 0.8]].map(|[a, b]| [x + m * a, y + m * b]).to_vec()
    } else {
        [[-m, -m], [m, -m], [m, m], [-m, m], [-m, -m]].map(|[a, b]| [x + a, y + b]).to_vec()
    };
    if case.pose_hz >= 1000.0 {
        picture.area(outline.iter().copied(), Colour(r, g, b, 0.75));
    }
    picture.line(outline, pen);
    if case.corrected {
        picture.line(polygon(24, 1.8 * m), Pen::new(colour, 1.1));
    }
}
