//! Where do the buffers of a step come from? From the step before: a thread keeps what it has given back.
//!
//! Fresh memory is cleared twice, by the system and by `vec!`, which costs as much as a fifth of a small step. A loan holds
//! whatever stood there before: it is for those who write all of it.

use std::cell::RefCell;
use std::ops::{Deref, DerefMut};
use std::thread::LocalKey;

use super::real::Real;

/// The buffers that a thread has at hand.
pub type Shelf<E> = LocalKey<RefCell<Vec<Vec<E>>>>;

/// Buffers on a shelf: more than one step has out at a time.
const SHELF: usize = 256;

/// A buffer of undefined numbers that goes back to the thread where it is dropped.
#[derive(Debug)]
pub struct Loan<E: Real> {
    buffer: Vec<E>,
    len: usize,
}

impl<E: Real> Loan<E> {
    /// `len` numbers, whatever they are.
    pub fn of(len: usize) -> Self {
        // A much longer one would be missing where it is needed, again and again.
        let fits = |buffer: &Vec<E>| buffer.len() >= len && buffer.len() <= len + len / 4;
        let found = E::shelf()
            .with_borrow_mut(|shelf| shelf.iter().rposition(fits).map(|at| shelf.swap_remove(at)));
        Self { buffer: found.unwrap_or_else(|| vec![E::default(); len]), len }
    }
}

impl<E: Real> Loan<E> {
    /// Gives the buffer away: to a tensor, whose gradient is a buffer that may come in its place.
    pub fn into_vec(mut self) -> Vec<E> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.truncate(self.len);
        buffer
    }
}

/// A buffer that comes to the shelf from elsewhere.
impl<E: Real> From<Vec<E>> for Loan<E> {
    fn from(buffer: Vec<E>) -> Self {
        Self { len: buffer.len(), buffer }
    }
}

impl<E: Real> Drop for Loan<E> {
    fn drop(&mut self) {
        let buffer = std::mem::take(&mut self.buffer);
        if buffer.is_empty() {
            return;
        }
        // A thread that ends has no shelf any more.
        let _ = E::shelf().try_with(|shelf| {
            let mut shelf = shelf.borrow_mut();
            if shelf.len() == SHELF {
                shelf.swap_remove(0);
            }
            shelf.push(buffer);
        });
    }
}

impl<E: Real> Deref for Loan<E> {
    type Target = [E];

    fn deref(&self) -> &[E] {
        &self.buffer[..self.len]
    }
}

impl<E: Real> DerefMut for Loan<E> {
    fn deref_mut(&mut self) -> &mut [E] {
        &mut self.buffer[..self.len]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_that_came_back_is_lent_again() {
        let mut first = Loan::<f32>::of(100);
        first[7] = 3.0;
        let place = first.as_ptr();
        drop(first);
        let again = Loan::<f32>::of(90);
        assert_eq!((again.as_ptr(), again.len(), again[7]), (place, 90, 3.0));
        assert_ne!(Loan::<f32>::of(90).as_ptr(), place);
    }
}
