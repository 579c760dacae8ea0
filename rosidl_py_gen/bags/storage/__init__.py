"""What reads the files of a bag, whatever their storage, and what is common to them."""
