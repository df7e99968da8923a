//! Chunks as rays want them: hierarchies that are read where they lie in the archive, checked when they are touched first.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::Detail;
use crate::error::{Error, Result};
use crate::rays::near::{Chunks, Near};
use crate::rays::{Branch, Bvh, BvhView, NO_TRIANGLE, Packet};
use crate::scene::Scene;

/// The chunks of some streamed meshes, mesh after mesh.
#[derive(Debug)]
struct Mapped {
    details: Vec<Arc<Detail>>,
    /// Per chunk its mesh and its number there.
    places: Vec<(usize, usize)>,
    /// Per chunk whether it was found whole, once it was looked at.
    whole: Vec<OnceLock<bool>>,
    failed: Mutex<Option<Error>>,
}

impl Mapped {
    /// Whether a chunk's checksums and references hold.
    fn check(&self, chunk: usize) -> Result<()> {
        let (mesh, number) = self.places[chunk];
        let detail = &self.details[mesh];
        let branches: &[Branch] = detail.branches(number).array()?;
        let packets: &[Packet] = detail.packets(number).array()?;
        let checked = BvhView::checked(branches, packets);
        checked.map(|_| ()).map_err(|problem| Error::Damaged {
            file: detail.archive().file().to_owned(),
            place: format!("branches of chunk {number}"),
            problem: problem.to_string(),
        })
    }
}

impl Chunks for Mapped {
    fn view(&self, chunk: usize) -> Option<BvhView<'_>> {
        let whole = self.whole[chunk].get_or_init(|| match self.check(chunk) {
            Ok(()) => true,
            Err(error) => {
                self.failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                false
            }
        });
        let (mesh, number) = self.places[chunk];
        let detail = &self.details[mesh];
        let arrays = || Some((detail.branches(number).known()?, detail.packets(number).known()?));
        arrays().filter(|_| *whole).map(|(branches, packets)| BvhView::known(branches, packets))
    }

    fn failure(&self) -> Option<Error> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Full resolution for a scene in which proxies stand for streamed meshes: the numbers of those, with what they stand for.
pub fn near(scene: &Scene, details: &[(usize, Arc<Detail>)]) -> Near {
    let mut mapped = Mapped { details: vec![], places: vec![], whole: vec![], failed: Mutex::new(None) };
    let (mut boxes, mut cell) = (Vec::new(), 0.0f32);
    for (mesh, (_, detail)) in details.iter().enumerate() {
        mapped.details.push(Arc::clone(detail));
        cell = cell.max(detail.cell());
        for number in 0..detail.chunk_count() {
            mapped.places.push((mesh, number));
            mapped.whole.push(OnceLock::new());
            boxes.push(detail.bounds(number));
        }
    }
    Near::new((Box::new(mapped), boxes), resident(scene, details), cell)
}

/// The meshes that the scene holds as they are: their hierarchy by places, and by place their triangles' numbers.
fn resident(scene: &Scene, details: &[(usize, Arc<Detail>)]) -> (Bvh, Vec<u32>) {
    let whole = |mesh: &usize| details.iter().all(|(streamed, _)| streamed != mesh);
    let ids: Vec<u32> =
        (0..scene.meshes.len()).filter(whole).flat_map(|mesh| scene.meshes[mesh].triangles.clone()).collect();
    let triangles: Vec<[u32; 3]> = ids.iter().map(|&id| scene.triangles[id as usize]).collect();
    let mut bvh = Bvh::build_triangles(&scene.vertices, &triangles);
    let named = |place: u32| if place == NO_TRIANGLE { NO_TRIANGLE } else { ids[place as usize] };
    let numbers = bvh.number_by_place().into_iter().map(named).collect();
    (bvh, numbers)
}
