//! The whole body of a half: what a model with a plane of symmetry shows of itself.

use crate::Cloud;
use crate::faces::MIRROR;
use crate::hexahedron::Hexahedron;
use crate::mirror::Mirror;

/// A half body and its mirror image: first what the half has, then the images of what does not lie on the plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Reflected {
    /// The whole body.
    pub cloud: Cloud,
    /// Node of each image.
    pub original: Vec<u32>,
}

impl Reflected {
    /// Adds its image to a half cloud.
    #[must_use]
    pub fn new(half: Cloud, mirror: &Mirror) -> Self {
        let nodes = half.points.len() as u32;
        let on_plane = mirror.holds(&half.points);
        let original: Vec<u32> = (0..nodes).filter(|&n| !on_plane[n as usize]).collect();
        let mut image: Vec<u32> = (0..nodes).collect();
        original.iter().zip(nodes..).for_each(|(&n, i)| image[n as usize] = i);
        // a mirrored cell or triangle is turned inside out
        let cell = |&[a, b, c, d]: &[u32; 4]| [a, b, d, c].map(|n| image[n as usize]);
        let triangle = |&[a, b, c]: &[u32; 3]| [a, c, b].map(|n| image[n as usize]);
        let Cloud { mut points, mut cells, mut faces, mut surface, mut surface_faces, quality, mut hexahedra } = half;
        points.extend(original.iter().map(|&n| mirror.image(&points[n as usize])).collect::<Vec<_>>());
        faces.iter_mut().for_each(|face| *face &= !MIRROR);
        faces.extend(original.iter().map(|&n| faces[n as usize]).collect::<Vec<_>>());
        let own = cells.len() as u32;
        let hexahedron = |h: &Hexahedron| {
            let [a, b, c, d, e, f, g, i] = h.corners;
            let corners = [e, f, g, i, a, b, c, d].map(|n| image[n as usize]);
            Hexahedron { corners, cells: h.cells.iter().map(|c| own + c).collect() }
        };
        hexahedra.extend(hexahedra.iter().map(hexahedron).collect::<Vec<_>>());
        cells.extend(cells.iter().map(cell).collect::<Vec<_>>());
        let mut outside = surface_faces.iter().map(|face| face & MIRROR == 0);
        surface.retain(|_| outside.next().unwrap_or(true));
        surface_faces.retain(|face| face & MIRROR == 0);
        surface.extend(surface.iter().map(triangle).collect::<Vec<_>>());
        surface_faces.extend_from_within(..);
        Self { cloud: Cloud { points, cells, faces, surface, surface_faces, quality, hexahedra }, original }
    }
}

impl Cloud {
    /// A half cloud that was made in the plane's own frame, in the frame of the body.
    #[must_use]
    pub fn turned(mut self, mirror: &Mirror) -> Self {
        self.points.iter_mut().for_each(|p| *p = mirror.from_own_frame(*p));
        self
    }
}
