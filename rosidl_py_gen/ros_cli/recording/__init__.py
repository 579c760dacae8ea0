"""What ``bag record`` does: record begins and ends it, selection chooses topics, recorder receives, writer writes."""
