"""Problems with known answers: scenes, hybrid systems, records, and the truth of each."""
