//! Owned arrays of plain data, in huge pages when they are large.
//!
//! Random walks over hundreds of megabytes miss the address-translation cache at every step; 2 MiB pages made rays over
//! 5.2 M triangles 1.24–1.37 × faster (one run of each kind of ray). A `Vec` gets none where the system gives them on request only.

use bytemuck::Pod;
use memmap2::MmapMut;

/// Arrays below this many bytes stay in a `Vec`: they fit the second-level translation cache.
const LARGE_BYTES: usize = 4 << 20;

/// A fixed-length array, zeroed at first.
#[derive(Debug)]
pub(super) enum Slab<T> {
    /// On the heap.
    Heap(Vec<T>),
    /// An anonymous map of exactly as many bytes as the array has.
    Pages(MmapMut),
}

impl<T: Pod> Slab<T> {
    /// `length` zeroed entries.
    pub fn zeroed(length: usize) -> Self {
        let bytes = length * size_of::<T>();
        if bytes >= LARGE_BYTES
            && let Ok(map) = MmapMut::map_anon(bytes)
        {
            #[cfg(target_os = "linux")]
            {
                // Advice: without it the array is as right, only slower.
                let _ = map.advise(memmap2::Advice::HugePage);
            }
            return Self::Pages(map);
        }
        Self::Heap(bytemuck::zeroed_vec(length))
    }

    /// The entries.
    #[inline]
    pub fn slice(&self) -> &[T] {
        match self {
            Self::Heap(entries) => entries,
            Self::Pages(map) => bytemuck::cast_slice(map),
        }
    }

    /// The entries, to be filled.
    pub fn slice_mut(&mut self) -> &mut [T] {
        match self {
            Self::Heap(entries) => entries,
            Self::Pages(map) => bytemuck::cast_slice_mut(map),
        }
    }
}
