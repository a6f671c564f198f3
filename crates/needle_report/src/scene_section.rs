//! A section of a scene along its instrument: coloured regions, path, targets.

use super::{
    picture::{Anchor, Colour, Pen, Picture, Type},
    plot::{Axis, INK, MUTED, Panel, label},
    regions,
    section::{Plane, Section},
};
use needle_core::scene::{InstrumentKind, Scene};
use needle_core::twin::{Body, REST};

const WIDTH: u32 = 960;
/// Left and right edge of the panel, px.
const SIDES: [f64; 2] = [84.0, 720.0];
const TOP: f64 = 84.0;

/// The section of a scene's body by the plane in which the instrument moves; lengths in mm.
pub(super) fn scene_section(scene: &Scene, body: &Body) -> Picture {
    let plane = Plane::of(scene.instrument.as_ref());
    let cloud = &body.cloud;
    let section = Section::new(&cloud.points, &cloud.cells, &cloud.surface, &plane);
    let region = body.regions(scene);
    let node = |i: u32| section.nodes.get(i as usize).map(|&n| cloud.points[n as usize]);
    let place = |i: u32| -> [f64; 2] {
        let p = node(i).unwrap_or_else(|| {
            let e = &section.on_edges[i as usize - section.nodes.len()];
            let [a, b] = [e.a, e.b].map(|n| node(n).unwrap_or_default());
            [0, 1, 2].map(|k| a[k] + e.t * (b[k] - a[k]))
        });
        [1e3 * plane.along(&p), 1e3 * p[2]]
    };
    let corners = || cloud.points.iter();
    let x = Axis::holding(corners().map(|p| 1e3 * plane.along(p)), 8, 0.05);
    let z = Axis::holding(corners().map(|p| 1e3 * p[2]), 6, 0.12);
    let height = (SIDES[1] - SIDES[0]) * (z.max - z.min) / (x.max - x.min);
    let panel = Panel { frame: [SIDES[0], TOP, SIDES[1], TOP + height], x, y: z };
    let mut picture = Picture::new(WIDTH, (TOP + height + 64.0).max(260.0) as u32);
    panel.grid(&mut picture, true);
    for (triangle, cell) in section.cut.iter().zip(&section.cell[2]) {
        let [r, g, b] = regions::colour(region[*cell as usize]);
        let corners = triangle.map(|i| {
            let [x, z] = place(i);
            panel.at(x, z)
        });
        picture.area(corners, Colour(r, g, b, 1.0));
        // the rasteriser leaves hairlines between neighbouring triangles
        picture.line([corners[0], corners[1], corners[2], corners[0]], Pen::new(Colour(r, g, b, 1.0), 0.6));
    }
    tool(&mut picture, &panel, scene, body.top, &plane);
    // names of neighbouring targets alternate above and below
    for (target, below) in scene.targets.iter().zip([-7.0, 15.0].into_iter().cycle()) {
        let at = panel.at(1e3 * plane.along(&target.position), 1e3 * target.position[2]);
        picture.dot(at, 4.0, INK);
        picture.text(
            [at[0] + 6.0, at[1] + below],
            target.name.clone(),
            Type { size: 12.0, colour: INK, ..label(Anchor::Start) },
        );
    }
    captions(&mut picture, scene, TOP + height, plane.azimuth);
    picture
}

/// The path of the instrument.
fn tool(picture: &mut Picture, panel: &Panel, scene: &Scene, top: f64, plane: &Plane) {
    let Some(instrument) = &scene.instrument else { return };
    let level = |[x, y]: [f64; 2]| plane.along(&[x, y, 0.0]);
    let (x, slope) = (level(instrument.entry.map(|m| m.get())), level(instrument.slope()));
    let depth = scene.motion.as_ref().map_or(0.0, |m| m.depth.get());
    let at = |x: f64, z: f64| panel.at(1e3 * x, 1e3 * z);
    match &instrument.kind {
        InstrumentKind::Needle(_) => {
            let down = depth / 1.0_f64.hypot(slope);
            let ends = [at(x - slope * 0.1 * top, 1.1 * top), at(x + slope * down, top - down)];
            picture.line(ends, Pen::new(INK, 2.0).dashed([7.0, 4.0]));
        }
        InstrumentKind::Indenter { diameter, .. } => {
            let half = 0.5 * diameter.get();
            picture.line([at(x - half, top), at(x + half, top)], Pen::new(INK, 5.0));
        }
        InstrumentKind::Plate => {}
    }
}

fn captions(picture: &mut Picture, scene: &Scene, bottom: f64, azimuth: f64) {
    let across = if azimuth == 0.0 {
        "x".to_owned()
    } else {
        format!("the direction {:.0} degrees from x", azimuth.to_degrees())
    };
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    picture.text([SIDES[0], 36.0], format!("{}: cut along the instrument", scene.name), title);
    picture.text(
        [SIDES[0], 60.0],
        format!("z over {across} in mm, undeformed; dashed: the needle's path"),
        label(Anchor::Start),
    );
    picture.text(
        [0.5 * (SIDES[0] + SIDES[1]), bottom + 44.0],
        format!("{across} in mm"),
        Type { colour: MUTED, ..label(Anchor::Middle) },
    );
    let named = scene.regions.iter().map(|r| format!("{} ({})", r.name, r.material));
    for (i, text) in (0_u8..).zip(std::iter::once(REST.to_owned()).chain(named)) {
        let y = TOP + 18.0 + 24.0 * f64::from(i);
        let [r, g, b] = regions::colour(i);
        picture.rectangle([SIDES[1] + 18.0, y - 12.0], [SIDES[1] + 34.0, y + 2.0], Colour(r, g, b, 1.0));
        picture.text([SIDES[1] + 42.0, y], text, Type { colour: INK, ..label(Anchor::Start) });
    }
}
