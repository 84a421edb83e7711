# Numbers of lme4, pbkrtest for each study of designs.csv:
#   python designs.py > designs.csv && Rscript lme4.R > lme4.csv
# lme4 stops early now and then: of several optimisers and starts, the lowest criterion counts.
suppressMessages({library(lme4); library(pbkrtest)})
options(contrasts = c("contr.sum", "contr.sum"), digits = 10)
rows <- read.csv("designs.csv", colClasses = "character")
rows$value <- as.numeric(rows$value)

likeliest <- function(formula, data) {
  controls <- list(
    lmerControl(optimizer = "bobyqa", optCtrl = list(rhobeg = 0.2, rhoend = 1e-9, maxfun = 1e5)),
    lmerControl(optimizer = "nloptwrap", optCtrl = list(xtol_abs = 1e-10, ftol_abs = 1e-12, maxeval = 1e5)))
  best <- NULL
  for (control in controls) {
    first <- suppressWarnings(suppressMessages(lmer(formula, data, control = control)))
    starts <- list(getME(first, "theta"), 0.1 + 0 * getME(first, "theta"), 3 + 0 * getME(first, "theta"))
    for (start in starts) {
      model <- suppressWarnings(suppressMessages(lmer(formula, data, start = start, control = control)))
      if (is.null(best) || REMLcrit(model) < REMLcrit(best)) best <- model
    }
  }
  best
}

random_effects <- function(data) { # those that the values can tell, as the program's
  parts <- character(0); seen <- list()
  for (name in c("subject", "of_cell", "of_recording")) {
    codes <- as.integer(factor(data[[name]], levels = unique(data[[name]])))
    repeated <- any(duplicated(codes)); same <- any(sapply(seen, function(s) all(s == codes)))
    if (repeated && !same) { parts <- c(parts, name); seen <- c(seen, list(codes)) }
  }
  parts
}

cat("study,effect,estimate,error,criterion,singular,f,df1,df2,p\n")
for (study in unique(rows$study)) {
  data <- rows[rows$study == study, ]
  data$cell <- paste(data$condition, data$compensated)
  data$of_cell <- paste(data$subject, data$cell)
  data$of_recording <- paste(data$subject, data$condition, data$recording)
  both <- length(unique(data$compensated)) > 1
  pair <- if (both) c("a yes", "a no") else c("b no", "a no")
  two <- data[data$cell %in% pair, ]
  two$first <- ifelse(two$cell == pair[1], 0.5, -0.5)
  bars <- function(d) paste0("(1|", random_effects(d), ")", collapse = " + ")
  model <- likeliest(as.formula(paste("value ~ first +", bars(two))), two)
  cat(sprintf("%s,pair,%.9g,%.9g,%.9g,%s,,,,\n", study, fixef(model)[2],
              sqrt(vcov(model)[2, 2]), REMLcrit(model), isSingular(model)))
  factors <- c(if (both) "compensated", "condition", if (length(unique(data$group)) > 1) "group")
  fixed <- paste(factors, collapse = " * ")
  random <- random_effects(data)
  full <- likeliest(as.formula(paste("value ~", fixed, "+", bars(data))), data)
  # Kenward and Roger's test of the model without variances of zero
  variances <- as.data.frame(VarCorr(full))
  kept <- intersect(random, variances$grp[variances$vcov > 1e-7 * max(variances$vcov)])
  if (length(kept) == 0) next # no random effect is left
  reduced <- likeliest(as.formula(paste("value ~", fixed, "+", paste0("(1|", kept, ")", collapse = " + "))), data)
  columns <- attr(model.matrix(reduced), "assign"); labels <- attr(terms(reduced), "term.labels")
  for (k in seq_along(labels)) {
    contrasts <- diag(length(columns))[columns == k, , drop = FALSE]
    test <- unlist(KRmodcomp(reduced, contrasts)$test["Ftest", c("stat", "ndf", "ddf", "p.value")])
    cat(sprintf("%s,%s,,,%.9g,%s,%.9g,%d,%.9g,%.9g\n", study, labels[k], REMLcrit(full),
                isSingular(full), test[1], as.integer(test[2]), test[3], test[4]))
  }
}
