//! Behaviour trees with typed ports, a blackboard and a journal.
