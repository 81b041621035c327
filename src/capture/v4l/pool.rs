//! Frame memory that comes back: a frame's bytes return here when its last clone is dropped.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use bytes::Bytes;

/// Blocks kept for later; more are given back to the allocator.
const MOST: usize = 32;

#[derive(Debug, Default)]
struct Shelf(Mutex<Vec<Vec<u8>>>);

/// A shelf of blocks.
#[derive(Debug, Clone, Default)]
pub struct Pool(Arc<Shelf>);

struct Block {
    data: Vec<u8>,
    home: Weak<Shelf>,
}

impl AsRef<[u8]> for Block {
    fn as_ref(&self) -> &[u8] {
        &self.data
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        let Some(home) = self.home.upgrade() else {
            return;
        };
        let mut shelf = home.0.lock().unwrap_or_else(PoisonError::into_inner);
        if shelf.len() < MOST {
            let mut data = std::mem::take(&mut self.data);
            data.clear();
            shelf.push(data);
        }
    }
}

impl Pool {
    /// Bytes that `fill` wrote into a block of the shelf (empty when handed over).
    pub fn bytes(&self, fill: impl FnOnce(&mut Vec<u8>)) -> Bytes {
        let mut data = self
            .0
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop()
            .unwrap_or_default();
        fill(&mut data);
        Bytes::from_owner(Block {
            data,
            home: Arc::downgrade(&self.0),
        })
    }

    /// Blocks on the shelf.
    pub fn shelved(&self) -> usize {
        self.0
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_comes_back_when_its_last_clone_goes() {
        let pool = Pool::default();
        let bytes = pool.bytes(|b| b.extend_from_slice(b"frame"));
        let (clone, slice) = (bytes.clone(), bytes.slice(1..3));
        drop((bytes, clone));
        assert_eq!((pool.shelved(), &slice[..]), (0, &b"ra"[..]));
        drop(slice);
        assert_eq!(pool.shelved(), 1);
        assert_eq!(
            pool.bytes(|b| assert!(b.is_empty() && b.capacity() >= 5))
                .len(),
            0
        );
    }
}
