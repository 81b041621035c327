//! Reading on behind damage: where, by which declarations, and whether the damage costs data.

use std::collections::BTreeSet;
use std::io::{self, BufRead, Read, Seek};
use std::sync::Arc;

use bytes::Bytes;

use super::{Scan, Step};
use crate::records::{self, ChannelRecord, Damage, Declared, MessageRecord, RecordFinder};

/// Declarations that a sound summary repeats; none without one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Spare {
    pub declared: Declared,
    /// The summary counts no chunk: messages of its channels stand by themselves.
    pub is_without_chunks: bool,
}

impl<R: BufRead> Scan<R> {
    /// The scan of a file whose summary repeats these declarations: a message whose channel is not declared before it, for that stood in
    /// a chunk that is damaged, or was hit itself, is still known by them.
    pub fn with_spare(mut self, spare: Spare) -> Self {
        self.spare = spare;
        self
    }

    /// A channel of the summary, which counts as declared from here on.
    pub(super) fn spared(&mut self, id: u16) -> Option<Arc<ChannelRecord>> {
        let spare = &self.spare.declared;
        let channel = Arc::clone(spare.channels.get(&id)?);
        let declared = &mut self.learnt.declared;
        if let Some(schema) = spare.schemas.get(&channel.schema_id) {
            declared.schemas.entry(schema.id).or_insert(schema.clone());
        }
        declared.channels.insert(id, Arc::clone(&channel));
        Some(channel)
    }

    /// From where to look for the next sound record after damage at `offset` that loses the thread: nothing between the last
    /// chunk's content and it is a chunk that was read. Outside chunks, the message before may have swallowed what follows it.
    fn search_from(&self, offset: u64) -> u64 {
        let from = match (self.behind_chunk, self.last_outside) {
            (0, Some(last)) => last + 1,
            (0, None) => offset + 1,
            (behind, _) => behind,
        };
        // Never again where it went on before.
        let least = self.jumped_to.map_or(0, |to| to + 1);
        from.min(offset + 1).max(least)
    }

    /// Whether damage that was just stepped on costs data, as far as the file shows: the summary holds none, and its counts are
    /// believed against the file only where nothing shows that they are what was hit. A missing end costs what
    /// [`Scan::cut_in_data`] says.
    pub fn costs_data(&self, damage: &Damage) -> bool {
        match damage {
            Damage::Cut { .. } | Damage::NoEnd | Damage::JoinedLog => false,
            Damage::DataCrc { .. } | Damage::AfterEnd { .. } => true,
            Damage::MessageCount { stated, found } | Damage::ChunkCount { stated, found } => {
                stated > found && self.counts_stand
            }
            _ => !self.past_data || self.learnt.unknown > 0,
        }
    }

    /// Channels whose messages may stand outside chunks, behind damage.
    fn outside(&self) -> BTreeSet<u16> {
        // A file that keeps its messages in chunks has none outside: what looks like one there is the content of a chunk
        // whose head is gone, and nothing vouches for that. Behind the data only the summary's declarations are left.
        if self.learnt.chunks > 0 || self.past_data {
            return BTreeSet::new();
        }
        let declared = self.learnt.declared.channels.keys();
        let spare = self.spare.declared.channels.keys();
        let of_summary = spare.filter(|_| self.spare.is_without_chunks);
        declared.chain(of_summary).copied().collect()
    }

    /// The next message of a truncated chunk's content; the record in which it ends is none.
    pub fn next_salvaged(
        &mut self,
        offset: u64,
        content: &mut Bytes,
    ) -> Option<(Arc<ChannelRecord>, MessageRecord)> {
        while let Some(Ok((opcode, body))) = records::next_inner(content) {
            let step = self.data_record(offset, opcode, &body, true);
            if let Ok(Some(Step::Message {
                channel, message, ..
            })) = step
            {
                return Some((channel, message));
            }
        }
        None
    }

    /// After damage that was just stepped on: where reading lost the thread, or ended before the data did, it goes on at the next
    /// sound record, whose offset is returned; `None` = it goes on by itself, or there is no more.
    pub fn go_on<F: Read + Seek>(
        &mut self,
        finder: &mut RecordFinder<F>,
        offset: u64,
        damage: &Damage,
    ) -> io::Result<Option<u64>>
    where
        R: Seek,
    {
        let stopped = self.done && !self.past_data;
        if !stopped && !damage.loses_the_thread() {
            return Ok(None);
        }
        let next = finder.find(self.search_from(offset), &self.outside())?;
        if let Some(next) = next {
            self.jump(next)?;
        }
        Ok(next)
    }

    fn jump(&mut self, offset: u64) -> io::Result<()>
    where
        R: Seek,
    {
        self.jumped_to = Some(offset);
        self.records.jump(offset)?;
        (self.chunk, self.pending, self.truncated) = (None, None, None);
        (self.cut, self.done, self.past_data) = (false, false, false);
        Ok(())
    }
}
