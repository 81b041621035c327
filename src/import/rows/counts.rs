//! Numbers of cells in the rows of a table, and the lines from which they are others.

/// So many rows one after the other with another number of cells are no slip: the columns changed there.
const BLOCK_ROWS: usize = 3;
/// Changes that are named: a table that changes more often has rows of any length.
const BLOCKS_NAMED: usize = 4;

/// Rows one after the other whose cells may be equally many: empty ones at the end need not be written.
#[derive(Debug, Clone, Copy)]
struct Block {
    first_line: u64,
    least: usize,
    most: usize,
    rows: usize,
}

/// Blocks of rows, in the order of the file.
#[derive(Debug, Default)]
pub(super) struct Counts {
    blocks: Vec<Block>,
    more: bool,
}

impl Counts {
    /// A row by its cells, and by those up to the last that holds something.
    pub fn row(&mut self, line: u64, cells: usize, filled: usize) {
        let is_full = self.blocks.len() > BLOCKS_NAMED;
        match self.blocks.last_mut() {
            Some(b) if filled <= b.most && cells >= b.least => {
                b.least = b.least.max(filled);
                b.most = b.most.min(cells);
                b.rows += 1;
            }
            _ if is_full => self.more = true,
            _ => self.blocks.push(Block {
                first_line: line,
                least: filled,
                most: cells,
                rows: 1,
            }),
        }
    }

    /// Line from which on the rows of a whole block have another number of cells; `None` = rows differ singly or not at all.
    pub fn changes_at(&self) -> Option<u64> {
        let few = !self.more && self.blocks.len() > 1;
        let whole = few && self.blocks.iter().all(|b| b.rows >= BLOCK_ROWS);
        whole.then(|| self.blocks[1].first_line)
    }

    /// `rows have 6 cells, from line 12 on 7`.
    pub fn words(&self) -> String {
        let mut words = String::from("rows have ");
        for (i, block) in self.blocks.iter().enumerate() {
            words += &match i {
                0 => format!("{} cells", block.most),
                _ => format!(", from line {} on {}", block.first_line, block.most),
            };
        }
        words
    }
}
